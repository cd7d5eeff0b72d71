"""Knowledge after runs that the diagnosis held out."""

from collections.abc import Callable

import numpy as np
import pytest

from dpr_lab.arrays import Array
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.planning import knowledge
from dpr_lab.planning.information import PresentModel
from dpr_lab.planning.knowledge import known_after
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests.one_cause import of_runs, one_cause


def test_held_out_runs_add_no_information_about_causes_whose_probabilities_lack_them(
    recorded: Callable[..., list[Run]], paper: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = list[list[str]]()

    def information(recordings: Recordings, model: PresentModel) -> Array:
        names.append([record.run.name for record in recordings.records])
        return np.eye(len(model.columns))

    monkeypatch.setattr(knowledge, "information_of_runs", information)
    runs = recorded({}, duration=1.0)[:2]
    diagnosis = of_runs(one_cause(), *(run.name for run in runs))
    assert diagnosis.evidence is not None
    fitted, unseen = diagnosis.evidence.recordings
    used = [fitted, unseen.model_copy(update={"held_out": True})]
    separate = diagnosis.model_copy(update={"evidence": Evidence.model_construct(recordings=used)})
    for made in (diagnosis, separate):
        assert len(known_after(runs, paper, made).made) == 2
    assert names == [[run.name for run in runs], [runs[0].name]]
