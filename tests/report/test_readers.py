"""Texts and pages that new users misunderstood in earlier versions."""

from types import SimpleNamespace
from typing import Any

import pytest

from dpr_lab.errors import DprError
from dpr_lab.gap.result.evidence import Evidence, JointFriction
from dpr_lab.report.gap.next_steps import next_steps
from dpr_lab.report.gap.sections.friction import friction_figure, friction_words
from dpr_lab.report.pages.page import Section, page_html
from dpr_lab.report.tables import interval_words
from dpr_lab.workflows import diagnose as diagnose_job


def test_commands_between_backticks_are_set_as_code() -> None:
    page = page_html("Title", "Summary", [Section("One", ("Run `dpr-lab <x>` now.",))])
    assert "Run <code>dpr-lab &lt;x&gt;</code> now." in page


def test_an_undetermined_friction_torque_does_not_hide_the_curve() -> None:
    curve = JointFriction(
        speed_rad_per_s=[-2.0, -1.0, -0.02, 0.02, 1.0, 2.0],
        torque_Nm=[-3e-3, -2e-3, 1e-3, -1e-3, 2e-3, 3e-3],
        std_Nm=[1e-5, 1e-5, 4e-2, 4e-2, 1e-5, 1e-5],
        coefficients=2,
    )
    made: Any = SimpleNamespace(evidence=Evidence.model_construct(friction={"joint1": curve}), effects=[])
    assert "at 0.0200 rad/s (not distinguishable from zero) and" in friction_words(made)[0]
    (axes,) = friction_figure(made).axes
    assert axes.get_ylim()[1] < 10


def test_after_an_unexplained_gap_a_probable_effect_is_not_excluded() -> None:
    held_out = SimpleNamespace(held_out={})
    gap = SimpleNamespace(after_rad={"joint1": 1e-3}, floor_rad={"joint1": 1e-4}, closed_held_out=held_out)
    made: Any = SimpleNamespace(verdict="unexplained", rivals=[], advice=[], checks=[], gap=gap, only_uncertain=False)
    made.hints, made.checks_done, made.effects, made.only_free_run = [], [], [], False
    made.basis, made.evidence = "releases left out", None
    assert next_steps(made)[0].startswith("No effect of the library is the cause")
    made.basis = "one release"
    assert next_steps(made)[0].startswith("One release does not exclude the effects of the library: record further")
    made.rivals = [SimpleNamespace(name="coulomb_joint1", probability=0.49)]
    (step,) = next_steps(made)
    assert "neither confirm nor exclude Coulomb friction, joint 1 [coulomb_joint1]: record further releases" in step
    pieces = [SimpleNamespace(name=name, sha256="1") for name in ("run 0-10 s", "run 10-20 s")]
    made.rivals, made.basis, made.evidence = [], "held-out runs", SimpleNamespace(recordings=pieces)
    assert next_steps(made)[0].startswith("One release does not exclude")
    made.only_free_run = True
    assert next_steps(made) == ["Check the scale of each recorded angle and input, then record a further release."]
    made.hints = ["If the angles are multiplied by 0.5, one effect fewer explains the recordings."]
    assert next_steps(made)[0].startswith("Check the description of the recordings as stated in the verdict")


def test_intervals_of_parameters_have_the_decimals_of_their_width() -> None:
    parameter: Any = SimpleNamespace(value=1.356e-3, std=None, interval90=(1.13e-3, 1.6e-3))
    assert interval_words(parameter) == "0.00113 to 0.00160"


def test_a_full_disk_does_not_lose_the_verdict(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object) -> None:
        raise DprError("no space left")

    monkeypatch.setattr("dpr_lab.report.plain.write_json", fail)
    diagnosis: Any = SimpleNamespace(sentence="No gap.", to_json=dict)
    with pytest.raises(DprError, match=r"no space left. Verdict of the diagnosis: No gap"):
        with diagnose_job.diagnosis_folder(diagnosis, tmp_path):
            pass
