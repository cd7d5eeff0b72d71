"""The law against its closed form: a joint that passes the magnet is braked there, and nowhere else."""

import math

from dpr_lab.effects import EFFECTS  # before the module: the table loads it
from dpr_lab.effects.quantities import Joint
from dpr_lab_magnet import magnet


def passing(angle: float, speed: float) -> Joint:
    return Joint(t=0.0, angle=angle, speed=speed, displacement=0.0, force=0.0, direction=0.0)


def test_the_table_has_both_joints() -> None:
    assert {"magnet_joint1", "magnet_joint2"} <= set(EFFECTS)


def test_full_damping_at_the_magnet() -> None:
    assert math.isclose(magnet(passing(0.0, 3.0), 2e-3, 0.3), -6e-3)


def test_none_on_the_other_side() -> None:
    assert abs(magnet(passing(math.pi, 3.0), 2e-3, 0.3)) < 1e-11
