"""Knowledge after runs or pieces that the diagnosis held out, and with the scale of the diagnosis."""

from collections.abc import Callable

import numpy as np
import pytest

from dpr_lab.arrays import Array
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.screen import pieces
from dpr_lab.gap.screen.pieces import PieceSettings
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.planning import knowledge
from dpr_lab.planning.information import PresentModel
from dpr_lab.planning.knowledge import known_after, schur_complement
from dpr_lab.planning.stopping import recorded_releases
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests.one_cause import of_runs, one_cause


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Names of the runs whose information each call of `known_after` counts."""
    names = list[list[str]]()

    def information(recordings: Recordings, model: PresentModel) -> Array:
        names.append([record.run.name for record in recordings.records])
        return np.eye(len(model.columns))

    monkeypatch.setattr(knowledge, "information_of_runs", information)
    return names


def test_held_out_runs_add_no_information_about_causes_whose_probabilities_lack_them(
    recorded: Callable[..., list[Run]], paper: Rig, fitted: list[list[str]]
) -> None:
    runs = recorded({}, duration=1.0)[:2]
    diagnosis = of_runs(one_cause(), *(run.name for run in runs))
    assert diagnosis.evidence is not None
    first, unseen = diagnosis.evidence.recordings
    used = [first, unseen.model_copy(update={"held_out": True})]
    separate = diagnosis.model_copy(update={"evidence": Evidence.model_construct(recordings=used)})
    for made in (diagnosis, separate):
        assert len(known_after(runs, paper, made).made) == 2
    assert fitted == [[run.name for run in runs], [runs[0].name]]


def test_held_out_pieces_of_one_long_run_add_no_information(
    recorded: Callable[..., list[Run]], paper: Rig, fitted: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "PIECES", PieceSettings(length_s=1.0, from_s=3.0))
    run = recorded({}, duration=4.0)[0]
    diagnosis = of_runs(one_cause(), *(f"{run.name} {k}-{k + 1} s" for k in range(4)))
    assert diagnosis.evidence is not None
    used = [piece.model_copy(update={"held_out": k % 2 == 1}) for k, piece in enumerate(diagnosis.evidence.recordings)]
    divided = diagnosis.model_copy(update={"evidence": Evidence.model_construct(recordings=used)})
    assert len(known_after([run], paper, divided).made) == 1
    known_after([run], paper, of_runs(one_cause(), run.name))
    assert fitted == [[f"{run.name} 0-1 s", f"{run.name} 2-3 s"], [run.name]]


@pytest.mark.parametrize("factor", [1.1, 3.0])
def test_the_scale_is_as_uncertain_as_in_the_diagnosis(
    recorded: Callable[..., list[Run]], paper: Rig, fitted: list[list[str]], factor: float
) -> None:
    """A 90 % interval from b / f to f b has the standard deviation ln(f) / 1.645 of ln(b)."""
    (run, *_), made = recorded({}, duration=1.0), one_cause()
    scale = Scale(b=made.scale_b, interval90=(made.scale_b / factor, made.scale_b * factor), fixed_by="bound")
    known = known_after([run], paper, of_runs(made, run.name).model_copy(update={"scale": scale}))
    b = float(known.model.estimate.ratios[SCALE])
    others = [i for i in known.fitted if i != SCALE]
    of_b = schur_complement(known.information, others, [SCALE])
    assert b * float(of_b[0, 0]) ** 0.5 == pytest.approx(1.645 / np.log(factor), rel=1e-3)


def test_two_files_that_are_named_like_pieces_are_two_releases() -> None:
    diagnosis = of_runs(one_cause(), "P1 0-10 s", "P1 10-20 s")
    assert recorded_releases(diagnosis) == 1
    assert diagnosis.evidence is not None
    first, second = diagnosis.evidence.recordings
    files = [first.model_copy(update={"sha256": "a"}), second.model_copy(update={"sha256": "b"})]
    films = diagnosis.model_copy(update={"evidence": Evidence.model_construct(recordings=files)})
    assert recorded_releases(films) == 2
