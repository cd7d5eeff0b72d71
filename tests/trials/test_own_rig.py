from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.trust import NOTHING
from dpr_lab.report.gap.sections.trust import trust_figure
from dpr_lab.report.gap.trust_trials import trust_words
from dpr_lab.rig import Rig
from dpr_lab.trials import own_rig
from dpr_lab.trials.own_rig import trust
from tests.a_diagnosis import made

LIBRARY = {name: EFFECTS[name] for name in ("coulomb_joint1", "coulomb_joint2")}


@pytest.mark.slow
def test_a_diagnosis_is_tried_on_plants_like_its_own_rig(recorded: Callable[..., Any], paper: Rig):
    runs = recorded({"coulomb_joint1": {"torque_Nm": 3e-3}}, duration=3.0)[:2]
    diagnosis = diagnose(runs, paper, library=LIBRARY)
    result: list[int] = []

    tried = trust(diagnosis, runs, paper, 4, library=LIBRARY, processes=2, on_trial=result.append)
    (here,) = trust(diagnosis, runs, paper, 1, library=LIBRARY).trials

    assert here == tried.trials[0].model_copy(update={"seconds": here.seconds}), "the same in whichever process"
    assert result == [0, 1, 2, 3, 4]
    assert [trial.kind for trial in tried.trials] == ["as found", "another", "another", "clean"]
    assert [set(trial.truth) for trial in tried.trials] == [
        {"coulomb_joint1"},
        {"coulomb_joint2"},
        {"coulomb_joint2"},
        set(),
    ]
    assert tried.trials[0].right == ["coulomb_joint1"], tried.trials[0]
    assert (tried.right.of, tried.wrong.of, tried.false_alarms.of) == (3, 3, 1)
    assert {(cell.true, cell.named) for cell in tried.confusion} >= {
        ("coulomb_joint1", "coulomb_joint1"),
        (NOTHING, NOTHING),
    }
    assert tried.seconds_each == pytest.approx(np.median([trial.seconds for trial in tried.trials]))

    def refuses(*runs: object, **options: object) -> Diagnosis:
        raise RunError("the model cannot follow the readings")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(own_rig, "diagnose", refuses)
        without = trust(diagnosis, runs, paper, 4, library=LIBRARY)
    assert [trial.verdict for trial in without.trials] == ["refused"] * 4
    assert (without.right.held, without.wrong.held, without.false_alarms.held) == (0, 0, 0)
    assert "In 4 trials the recordings were refused" in trust_words(diagnosis.model_copy(update={"trust": without}))[0]

    whole = diagnosis.model_copy(update={"trust": tried})
    assert trust_figure(whole) is not None
    assert trust_figure(diagnosis) is None
    assert "--trust 40" in trust_words(diagnosis)[0]


def test_blind_trials_are_recommended_unless_the_arm_moves() -> None:
    of_arm = {f"joint{joint}": 1e-3 for joint in (1, 2, 0)}
    arm_moves = made(gap=made().gap.model_copy(update={"before_rad": of_arm}))
    assert ["--trust 40" in trust_words(diagnosis)[0] for diagnosis in (made(), arm_moves)] == [True, False]


def test_an_error_of_a_prescribed_arm_is_not_drawn(paper: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = {"encoder_scale_joint0": {"excess": 0.01}, "spring_joint0": {"stiffness_Nm_per_rad": 0.1}}
    diagnosis = made().model_copy(update={"detectable": arm})
    result = trust(diagnosis, [], paper, 4)
    assert all(trial.truth.keys() <= set(diagnosis.model_effects) for trial in result.trials)
