"""The energy balance of a table with strong dry friction: zeros of the angles, and factor of the times."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.identification.misread.balance import energy_fit, energy_zeros, mounted_base, other_pace, residual_near
from dpr_lab.rig import Rig

Array = NDArray[np.float64]


def one_rod(rig: Rig, dry: float, t: Array, start: float) -> Array:
    """Angles (n, 2) of rods that move as one, with Coulomb friction, released near upright, rad."""
    a, b, d, e1, *_ = mounted_base(rig, rig.nominal).tolist()
    gravity = (e1 + d * rig.g / rig.L1) / (a + b + 2 * d)

    def slope(_: float, y: Array) -> list[float]:
        return [y[1], gravity * (np.sin(y[0]) - dry * np.tanh(y[1] / 0.02))]

    angle = solve_ivp(slope, (0.0, t[-1]), [start, 0.0], t_eval=t, rtol=1e-7, atol=1e-9, max_step=0.01).y[0]
    return np.column_stack([angle, angle])


@pytest.mark.parametrize("dry", [0.0, 0.05, 0.1])
def test_dry_friction_is_not_taken_for_a_zero(dry: float, paper: Rig):
    rig = paper.model_copy(update={"rods": paper.rods.model_copy(update={"mounted": "inner"})})
    rods = one_rod(rig, dry, np.linspace(0.0, 2.99, 300), np.pi - 1.5)
    added = energy_zeros(np.linspace(0.0, 2.99, 300), rods + 0.3, rig)
    assert added is not None
    assert added[0] == pytest.approx(-0.3, abs=3e-3)


@pytest.mark.parametrize("slower", [1.0, 1.5])
@pytest.mark.parametrize("dry", [0.0, 0.05, 0.1, 0.15])
def test_friction_does_not_change_the_factor_of_the_times(dry: float, slower: float, paper: Rig):
    rig = paper.model_copy(update={"rods": paper.rods.model_copy(update={"mounted": "inner"})})
    t = np.linspace(0.0, 2.99, 300)
    fit = energy_fit(slower * t, one_rod(rig, dry, t, np.pi - 1.5), None, rig)
    assert fit is not None
    assert slower * fit.time_scale == pytest.approx(1.0, rel=0.02)


def test_a_zero_error_of_a_small_swing_is_no_error_of_its_energy(paper: Rig):
    rig = paper.model_copy(update={"rods": paper.rods.model_copy(update={"mounted": "inner"})})
    t = np.linspace(0.0, 3.99, 400)
    rods = one_rod(rig, 0.002, t, np.pi - 0.15)
    fit = energy_fit(t, rods + 0.05, None, rig)
    assert fit is not None
    assert fit.residual > 0.3
    assert residual_near(t, rods + 0.05, None, rig) < 0.05
    assert residual_near(t, rods + 0.5, None, rig) > 0.5


@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_a_film_is_no_error_of_its_energy(seed: int, paper: Rig):
    rig = paper.model_copy(update={"rods": paper.rods.model_copy(update={"mounted": "inner"})})
    t = np.linspace(0.0, 719 / 240, 720)
    rods = one_rod(rig, 0.02, t, np.pi - 0.7)
    rods += np.random.default_rng(seed).normal(0, 0.015, (len(t), 1))
    fit = energy_fit(t, rods, None, rig)
    assert fit is not None
    assert fit.residual > 0.3
    assert residual_near(t, rods, None, rig) < 0.2
    assert residual_near(4 * t, rods, None, rig) > 0.5
    assert [other_pace(pace * t, rods, rig) for pace in (1.0, 4.0, 8.0)] == [1.0, 4.0, 8.0]


def test_no_speed_is_computed_across_a_gap(paper: Rig):
    rig = paper.model_copy(update={"rods": paper.rods.model_copy(update={"mounted": "inner"})})
    t = np.linspace(0.0, 15.96, 400)
    rods = one_rod(rig, 0.0, t, np.pi - 0.8)
    kept = (t < 1.0) | (t > 1.6)
    fit = energy_fit(t[kept], rods[kept], None, rig)
    assert fit is not None
    assert fit.residual < 0.05
