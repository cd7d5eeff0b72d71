"""Effects that a release of the inner rod alone distinguishes, unlike one of both rods."""

from dataclasses import replace

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Recorded
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.hypothesis.score_test import ScoreTest, score_test
from dpr_lab.gap.screen.record import record as screened
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record

PAIRS = [("base_tilt", "encoder_eccentricity_joint1"), ("com_offset_link1", "spring_joint1")]


def scores(paper: Rig, seed: int, *released: tuple[str, str]) -> ScoreTest:
    runs = []
    for mounted, pose in released:
        one = paper.model_copy(update={"poses": {pose: paper.poses[pose]}}).with_rods(mounted)
        runs += [replace(run, name=mounted) for run in record(load_plant("paper", seed), one, 4.0, 500)]
    recordings = Recordings(tuple(screened(run, paper) for run in runs), paper)
    _, problem, bare = fit_bare_model(recordings, nominal_ratios(paper))
    library = [EFFECTS[name] for pair in PAIRS for name in pair]
    return score_test(problem, bare.fit, library, Recorded((False,) * len(runs)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_recordings_of_the_inner_rod_alone_distinguish_twins(paper: Rig, seed: int) -> None:
    calm = scores(paper, seed, ("both", "X1"))
    more = scores(paper, seed, ("both", "X1"), ("inner", "X2"))
    for first, second in PAIRS:
        before, after = (test.cosine(test.best_score(first), test.best_score(second)) for test in (calm, more))
        assert before > 0.999
        assert after < 0.95
