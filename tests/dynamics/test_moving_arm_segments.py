"""Segments with a moving arm, compared with the other integrator, the energy balance and MuJoCo."""

import mujoco
import numpy as np
import pytest

from dpr_lab.dynamics.arm import CLAMPED, DRIVEN, FREE, ArmParameters, mounted
from dpr_lab.dynamics.moving_arm.swing import arm_segments, swing_segments
from tests.three_hinges import FRAME, L0, L1, G, Z, three_hinges
from tests.whole_swing import simulate_arm

ARM = ArmParameters(J0=0.01, c0=0.003, k0=0.2, mode="free")
START = np.array([0.1, 3.1, 2.5, 0.0, 1.0, 0.0])
T = np.arange(0, 2, 0.002)
PUSH = 0.1 * np.sin(5 * T)


def vector(arm=ARM, f0=0.0, gain=1.0):
    base, model = mounted(Z, FRAME, arm)
    a, b, d, e1, _, c1, c2 = base
    return [a, b, d, e1, c1, c2, model.inertia, model.friction, model.stiffness, f0, gain, L0]


@pytest.mark.parametrize(("mode", "number"), [("clamped", CLAMPED), ("free", FREE), ("driven", DRIVEN)])
def test_a_segment_is_the_swing_of_the_other_integrator(mode, number):
    arm = ARM._replace(mode=mode)
    other = simulate_arm(Z, FRAME, arm, START, T, drive=PUSH)
    own = swing_segments(vector(), (L1, G), arm_segments([T], [number], [PUSH], 1e-3), START[None])
    assert abs(own - other).max() < 1e-9


def test_a_common_factor_of_all_parameters_changes_nothing():
    segments = arm_segments([T], [FREE], [PUSH])
    p = np.array(vector(f0=0.01))
    own = swing_segments(p, (L1, G), segments, START[None])
    scaled = np.where(np.arange(12) == 11, p, 7.0 * p)
    assert abs(swing_segments(scaled, (L1, G), segments, START[None]) - own).max() < 1e-9


def test_a_free_arm_without_friction_keeps_its_energy():
    lossless = Z * np.array([1, 1, 1, 1, 1, 0, 0, 1, 1])
    base, model = mounted(lossless, FRAME, ARM._replace(c0=0.0))
    a, b, d, e1, e2, _, _ = base
    p = [a, b, d, e1, 0.0, 0.0, model.inertia, 0.0, model.stiffness, 0.0, 0.0, L0]
    x = swing_segments(p, (L1, G), arm_segments([T], [FREE], [0 * T], 5e-4), START[None])
    q0, q1, q2, w0, w1, w2 = x.T
    s1, s2, c1, c2 = np.sin(q1), np.sin(q2), np.cos(q1), np.cos(q2)
    turning = model.inertia + a * s1**2 + b * s2**2 + 2 * d * s1 * s2
    energy = 0.5 * turning * w0**2 + model.reach * w0 * (e1 * c1 * w1 + e2 * c2 * w2)
    energy += 0.5 * a * w1**2 + 0.5 * b * w2**2 + d * np.cos(q1 - q2) * w1 * w2
    energy += e1 * c1 + e2 * c2 + 0.5 * model.stiffness * q0**2
    assert np.ptp(w0) > 0.5
    assert np.ptp(energy) < 1e-7 * np.ptp(e1 * c1 + e2 * c2)


def test_mujoco_with_three_hinges_swings_the_same():
    own = swing_segments(vector(), (L1, G), arm_segments([T], [FREE], [PUSH]), START[None])
    other = three_hinges(mujoco, Z, ARM, START, T, PUSH)
    assert abs(own[:, :3] - other).max() < 1e-5


def test_an_input_that_is_linear_between_rows_follows_a_continuous_one():
    fine, every = np.arange(0, 2, 0.0005), 40
    signal = 0.1 * np.sin(9 * fine)
    truth = swing_segments(vector(), (L1, G), arm_segments([fine], [FREE], [signal]), START[None])[::every]
    rows, u = fine[::every], signal[::every]
    mean = np.add.reduceat(signal, np.arange(0, len(fine), every)) / every
    slope = np.append(np.diff(u) / np.diff(rows), 0.0)
    held, line = (
        swing_segments(vector(), (L1, G), arm_segments([rows], [FREE], [mean], slope=[s]), START[None])
        for s in (0 * slope, slope)
    )
    errors = [abs(own - truth)[:, :3].max() for own in (held, line)]
    assert errors[1] < 0.05 * errors[0]
