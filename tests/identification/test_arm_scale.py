"""Scale of a prescribed arm in the torque balance of its rod."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.estimation.arm_motion import arm_motion
from dpr_lab.identification.misread.readings import arm_scales
from dpr_lab.rig import Rig
from dpr_lab.run import Run

T = np.arange(0.0, 2.5, 0.01)


def swing(rig: Rig, factor: float) -> Run:
    """Simulate a rod on an arm whose angle is `factor` times its reading."""
    gravity = 1.5 * rig.g / rig.L1

    def slope(t: float, state: list[float]) -> list[float]:
        th, w = state
        speed, rise = 3.2 * np.cos(8 * t), -25.6 * np.sin(8 * t)
        coupled = -gravity * rig.L0 / rig.g * np.cos(th) * rise + np.sin(th) * np.cos(th) * speed**2
        return [w, gravity * np.sin(th) + coupled - 0.2 * w]

    rod = solve_ivp(slope, (0, T[-1]), [np.pi + 0.5, 0.0], t_eval=T, rtol=1e-8).y[0]
    theta = np.column_stack([0.4 * np.sin(8 * T) / factor, rod, rod])
    motion = arm_motion(T, theta[:, 0], "a")
    return Run("a", T, theta, None, None, rig.name, "", 100.0, mounting="inner", arm=motion)


@pytest.mark.parametrize("factor", [0.75, -1.5, 1.0])
def test_the_scale_of_a_prescribed_arm_follows_from_the_motion_of_its_rod(paper: Rig, factor: float) -> None:
    rig = paper.with_rods(mounted="inner")
    causes = [reading.cause for reading in arm_scales([swing(rig, factor)], rig)]
    stated = [float(number) for cause in causes for number in re.findall(r"turns by (\S+) times", cause)]
    assert stated == ([] if factor == 1.0 else [pytest.approx(factor, rel=0.05)])
