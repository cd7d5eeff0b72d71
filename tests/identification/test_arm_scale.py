"""Scale of a prescribed arm in the torque balance of its rod."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.estimation.arm_motion import arm_motion
from dpr_lab.identification.misread import tried
from dpr_lab.identification.misread.moving_arm_balance import angles_are_right
from dpr_lab.identification.misread.moving_arm_description import wrong_angles
from dpr_lab.identification.misread.readings import arm_scales
from dpr_lab.identification.misread.tried import check_description
from dpr_lab.rig import Rig
from dpr_lab.run import Run

T = np.arange(0.0, 2.5, 0.01)


def swing(rig: Rig, factor: float, reach: float = 0.4, step: float = 0.0) -> Run:
    """Simulate a rod on an arm whose angle is `factor` times its reading.

    Args:
        rig: lengths and gravity
        factor: true angle of the arm relative to its reading
        reach: amplitude of the arm, rad
        step: step of the readings of the arm, rad
    """
    gravity = 1.5 * rig.g / rig.L1

    def slope(t: float, state: list[float]) -> list[float]:
        th, w = state
        speed, rise = 8 * reach * np.cos(8 * t), -64 * reach * np.sin(8 * t)
        coupled = -gravity * rig.L0 / rig.g * np.cos(th) * rise + np.sin(th) * np.cos(th) * speed**2
        return [w, gravity * np.sin(th) + coupled - 0.2 * w]

    rod = solve_ivp(slope, (0, T[-1]), [np.pi + 0.5, 0.0], t_eval=T, rtol=1e-8).y[0]
    arm = reach * np.sin(8 * T) / factor
    theta = np.column_stack([np.round(arm / step) * step if step else arm, rod, rod])
    motion = arm_motion(T, theta[:, 0], "a")
    return Run("a", T, theta, None, None, rig.name, "", 100.0, mounting="inner", arm=motion)


def with_hold(run: Run) -> Run:
    """Add rows before the release, in which the rod is held and the arm stands still."""
    held = np.arange(-100, 0) / 100
    t, theta = np.concatenate([held, run.t]), np.concatenate([np.repeat(run.theta[:1], len(held), axis=0), run.theta])
    return replace(run, t=t, theta=theta, arm=arm_motion(t, theta[:, 0], "a"))


@pytest.fixture(scope="module")
def one_rod(paper: Rig) -> Rig:
    return paper.with_rods(mounted="inner")


def stated(runs: list[Run], rig: Rig) -> list[float]:
    causes = [reading.cause for reading in arm_scales(runs, rig)]
    return [float(number) for cause in causes for number in re.findall(r"turns by (\S+) times", cause)]


@pytest.mark.parametrize("factor", [0.75, -1.5, 1.0])
def test_the_scale_of_a_prescribed_arm_follows_from_the_motion_of_its_rod(one_rod: Rig, factor: float) -> None:
    expected = [] if factor == 1.0 else [pytest.approx(factor, rel=0.05)]
    run = swing(one_rod, factor)
    assert stated([run], one_rod) == expected
    assert stated([with_hold(run)], one_rod) == expected


def test_a_hold_hides_neither_right_angles_nor_a_wrong_scale(one_rod: Rig) -> None:
    assert angles_are_right([with_hold(swing(one_rod, 1.0))], one_rod)
    wrong = [with_hold(swing(one_rod, 2.0))]
    assert not angles_are_right(wrong, one_rod)
    assert "--scale theta0=2" in wrong_angles(wrong, one_rod, lambda _: None)


def test_several_recordings_have_one_scale(one_rod: Rig) -> None:
    runs = [swing(one_rod, factor) for factor in (0.74, 0.75, 0.82)]
    assert stated(runs, one_rod) == [pytest.approx(0.75, rel=0.02)]


def test_a_right_scale_is_not_doubted_although_coarse_readings_suggest_another(
    one_rod: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = swing(one_rod, 1.0, reach=0.05, step=0.025)
    monkeypatch.setattr(tried, "readings", lambda rig: ())
    assert stated([run], one_rod)
    assert not check_description([run], one_rod).tried
