"""Measured values and motors of a rig file that determine the scale of masses and torques, or do not."""

import pytest

from dpr_lab.rig import Rig, parse_rig
from dpr_lab.workflows.rig_drive import MotorMeasures
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_scale import scale_known, values_of_scale
from dpr_lab.workflows.rig_toml import Measure

ROD = Measure(0.2)


def measured(rig: Rig, *names: str) -> Rig:
    """Return the rig with some of its nominal values as measured values."""
    change = {
        name: rig.parameters[name].model_copy(update={"measured": p.nominal, "std": 0.01 * p.nominal})
        for name, p in rig.parameters.items()
        if name in names
    }
    return rig.model_copy(update={"parameters": {**rig.parameters, **change}})


@pytest.mark.parametrize(
    ("rods", "names", "known"),
    [
        ("both", ("m1", "m2", "mb"), False),
        ("both", ("m1", "J1"), False),
        ("both", ("m2", "l2"), True),
        ("both", ("m2", "J2"), True),
        ("inner", ("m1",), False),
        ("inner", ("m1", "l1"), True),
    ],
)
def test_one_weighed_rod_does_not_determine_the_scale_but_its_first_moment_does(
    rods: str, names: tuple[str, ...], known: bool
) -> None:
    two = rods == "both"
    text = draft_rig(RigMeasures("x", 0.3, 0.25 if two else None, ROD, ROD if two else None, mounted=rods))
    assert f"# Measured {values_of_scale(rods, 'free', 'clamped')} together determine the scale" in text
    assert scale_known(measured(parse_rig(text), *names)) is known


@pytest.mark.parametrize(("kt", "known"), [(Measure(0.06), False), (Measure(0.06, 0.001), True)])
def test_a_current_with_a_measured_kt_determines_the_scale(kt: Measure, known: bool) -> None:
    motor = MotorMeasures("current", kt=kt)
    measures = RigMeasures("x", 0.2, 0.19, ROD, ROD, L0=0.17, arm="driven", motor=motor)
    assert scale_known(parse_rig(draft_rig(measures))) is known
