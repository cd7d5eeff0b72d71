"""Effects that a release of the inner rod alone distinguishes: `python benchmarks/mounted.py`.

Each of 40 plants, its parameters drawn within 10 % of the published rig's, is recorded once from X1 with both rods, and
once more, from X2: with both rods' inner rod alone, or its elbow clamped. Two effects count as distinguished if
the best fit of one to the other, at its typical size, leaves five standard deviations of the noise.
"""

import sys
from dataclasses import replace

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Recorded
from dpr_lab.gap.advice.recording import DISTINGUISHED
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest, score_test
from dpr_lab.gap.screen.record import record as screened
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.shown import percent
from sim_device.plant.config import PlantConfig, load_plant
from sim_device.trials.offline_recorder import record

PAIRS = (
    ("base_tilt", "encoder_eccentricity_joint1"),
    ("com_offset_link1", "spring_joint1"),
    ("wrong_length_L1", "clock_rate"),
    ("air_drag_both", "air_drag_outer"),
    ("base_tilt", "encoder_offset_joint1"),
    ("com_offset_link2", "encoder_offset_joint2"),
)
SETS = {"both": ("both",), "both, inner": ("both", "inner"), "both, clamped": ("both", "clamped")}
MOUNTED = {"both": {}, "inner": {"mounted": "inner"}, "clamped": {"elbow": "clamped"}}


def drawn(seed: int) -> PlantConfig:
    """The published plant with parameters of its own."""
    plant, rng = load_plant("paper", seed), np.random.default_rng(seed)
    told = plant.model_dump()
    told["parameters"] = {name: value * rng.uniform(0.9, 1.1) for name, value in told["parameters"].items()}
    return PlantConfig.model_validate(told)


def released(plant: PlantConfig, rig: Rig, mounting: str) -> Run:
    """One release: of both rods from X1, of what else is mounted from X2."""
    pose = "X1" if mounting == "both" else "X2"
    one = rig.model_copy(update={"poses": {pose: rig.poses[pose]}}).with_rods(**MOUNTED[mounting])
    (run,) = record(plant, one, duration=5.0, rate_hz=500)
    return replace(run, name=mounting)


def tested(runs: list[Run], rig: Rig) -> ScoreTest:
    """Score test of the effects of all pairs on the bare model."""
    recordings = Recordings(tuple(screened(run, rig) for run in runs), rig)
    _, problem, bare = fit_bare_model(recordings, nominal_ratios(rig))
    library = [EFFECTS[name] for name in dict.fromkeys(name for pair in PAIRS for name in pair)]
    return score_test(problem, bare.fit, library, Recorded((False,) * len(runs), list))


def apart(test: ScoreTest, pair: tuple[str, str]) -> float:
    """Standard deviations by which the first, at its typical size, differs from the nearest that the second can do."""
    first, second = (test.of(name) for name in pair)
    assert first is not None
    assert second is not None
    size = np.array([parameter.typical for parameter in first.effect.amplitudes])
    typical: Score = replace(first, amplitudes=size)
    space = test.projected(first.columns)
    x = size / space.scale
    return float(np.sqrt(max(x @ space.H @ x, 0.0) * max(1 - test.cosine(typical, second) ** 2, 0.0)))


def main(trials: int = 40) -> None:
    """Print the share of trials in which each pair is distinguished, by recording."""
    rig = load_rig("paper")
    told = np.zeros((len(PAIRS), len(SETS)))
    for seed in range(1, trials + 1):
        runs = {mounting: released(drawn(seed), rig, mounting) for mounting in MOUNTED}
        for j, names in enumerate(SETS.values()):
            test = tested([runs[name] for name in names], rig)
            told[:, j] += [apart(test, pair) > DISTINGUISHED for pair in PAIRS]
    print(f"{'distinguished, of ' + str(trials):56}" + "".join(f"{name:>16}" for name in SETS))
    for pair, row in zip(PAIRS, told / trials, strict=True):
        print(f"{' from '.join(pair):56}" + "".join(f"{percent(share):>16}" for share in row))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
