"""Equations of motion, compared with a Lagrangian that SymPy derives from positions."""

import numpy as np
import pytest
import sympy as sp

from dpr_lab.dynamics.arm import CLAMPED, DRIVEN, FREE, ArmParameters, arm_accelerations, mass_matrix, mounted
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.equation import accelerations
from dpr_lab.effects.quantities import Motion, torques
from tests.whole_swing import energy

Z = np.array([0.21, 0.19, 0.11, 0.09, 0.2, 0.0011, 0.0009, 0.0014, 0.0012])
L0, L1, G = 0.3, 0.4, 9.81
FRAME = (L0, L1, G)
ARM = ArmParameters(J0=0.01, c0=0.003, k0=0.2, mode="free")
BASE, MODEL = mounted(Z, FRAME, ARM)


def motion(q, w):
    waves = np.sin(q[1]), np.cos(q[1]), np.sin(q[2]), np.cos(q[2])
    return Motion(0.0, *q, *w, *waves, *np.zeros(8))


def moved(q, w, mode, drive, tau1=0.0, tau2=0.0):
    return arm_accelerations(motion(q, w), BASE, torques(tau1, tau2), MODEL, mode, drive)


@pytest.fixture(scope="module")
def lagrangian():
    """Function (q, w) that returns mass matrix (3, 3), conservative forces (3,) and energy, from T and V."""
    q = sp.symbols("q0:3")
    w = sp.symbols("w0:3")
    l1, l2, m1, m2, mb, J1, J2 = (sp.Float(Z[i]) for i in (0, 1, 2, 3, 4, 7, 8))
    J0, k0 = sp.Float(ARM.J0), sp.Float(ARM.k0)
    outwards = sp.Matrix([sp.cos(q[0]), sp.sin(q[0]), 0])
    tangent = sp.Matrix([-sp.sin(q[0]), sp.cos(q[0]), 0])
    up = sp.Matrix([0, 0, 1])
    rod1 = sp.sin(q[1]) * tangent + sp.cos(q[1]) * up
    rod2 = sp.sin(q[2]) * tangent + sp.cos(q[2]) * up
    tip = L0 * outwards
    joint2 = tip + L1 * rod1

    def speed2(vector):
        velocity = vector.jacobian(q) * sp.Matrix(w)
        return velocity.dot(velocity)

    # A slender rod turns with kinetic energy J/2 |d(direction)/dt|^2.
    kinetic = (
        J0 * w[0] ** 2
        + m1 * speed2(tip + l1 * rod1)
        + J1 * speed2(rod1)
        + mb * speed2(joint2)
        + m2 * speed2(joint2 + l2 * rod2)
        + J2 * speed2(rod2)
    ) / 2
    height = m1 * l1 * rod1[2] + mb * L1 * rod1[2] + m2 * (L1 * rod1[2] + l2 * rod2[2])
    potential = G * height + k0 * q[0] ** 2 / 2
    momentum = sp.Matrix([kinetic]).jacobian(w).T
    mass = momentum.jacobian(w)
    forces = sp.Matrix([kinetic - potential]).jacobian(q).T - momentum.jacobian(q) * sp.Matrix(w)
    return sp.lambdify([q, w], [mass, forces, kinetic + potential], cse=True)


@pytest.fixture(scope="module")
def states():
    rng = np.random.default_rng(4)
    return np.hstack([rng.uniform(-np.pi, np.pi, (40, 3)), rng.normal(0, 8, (40, 3))])


def friction(omega):
    c1, c2 = Z[5:7]
    joint2 = c2 * (omega[2] - omega[1])
    return np.array([-ARM.c0 * omega[0], -c1 * omega[1] + joint2, -joint2])


def rod_parameters():
    a, b, d, e1, c1, c2 = base_parameters(Z, L1, G)
    return a, b, d, e1, d * G / L1, c1, c2


@pytest.mark.slow
def test_mass_matrix_is_that_of_the_kinetic_energy(lagrangian, states):
    for q, w in zip(states[:, :3], states[:, 3:], strict=True):
        expected, _, _ = lagrangian(q, w)
        M00, M01, M02 = mass_matrix(motion(q, w), BASE, MODEL)
        M12 = BASE.d * np.cos(q[1] - q[2])
        M = [[M00, M01, M02], [M01, BASE.a, M12], [M02, M12, BASE.b]]
        np.testing.assert_allclose(M, expected, rtol=1e-12, atol=1e-15)
        assert np.linalg.eigvalsh(expected)[0] > 0


@pytest.mark.slow
def test_a_free_arm_satisfies_lagrange_s_equations(lagrangian, states):
    for tau0, state in enumerate(states):
        q, w = state[:3], state[3:]
        outside = np.array([0.01 * tau0, 0.02, -0.03])
        M, forces, _ = lagrangian(q, w)
        expected = np.linalg.solve(M, forces.ravel() + friction(w) + outside)
        result = moved(q, w, FREE, *outside)
        np.testing.assert_allclose(result, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


@pytest.mark.slow
def test_rods_on_a_driven_arm_satisfy_lagrange_s_equations(lagrangian, states):
    for u, state in enumerate(states):
        q, w = state[:3], state[3:]
        M, forces, _ = lagrangian(q, w)
        right = (forces.ravel() + friction(w))[1:] - M[1:, 0] * u
        expected = np.linalg.solve(M[1:, 1:], right)
        alpha0, *result = moved(q, w, DRIVEN, float(u))
        assert alpha0 == u
        np.testing.assert_allclose(result, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


@pytest.mark.slow
def test_rods_on_a_clamped_arm_satisfy_lagrange_s_equations_and_equation_1(lagrangian, states):
    for state in states:
        q, w = state[:3], np.array([0.0, *state[4:]])
        M, forces, _ = lagrangian(q, w)
        expected = np.linalg.solve(M[1:, 1:], (forces.ravel() + friction(w))[1:])
        equation1 = accelerations(q[1], q[2], w[1], w[2], *rod_parameters(), 0.0, 0.0)
        np.testing.assert_allclose(equation1, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
        assert moved(q, w, CLAMPED, 5.0) == (0.0, *equation1)


def test_accelerations_of_the_rods_solve_the_two_equations_written_out(states):
    a, b, d, e1, e2, c1, c2 = rod_parameters()
    for t1, t2, w1, w2 in states[:, [1, 2, 4, 5]]:
        cos, sin = np.cos(t1 - t2), np.sin(t1 - t2)
        torque1 = -d * sin * w2**2 - c1 * w1 - c2 * (w1 - w2) + e1 * np.sin(t1) + 0.1
        torque2 = d * sin * w1**2 - c2 * (w2 - w1) + e2 * np.sin(t2) - 0.2
        expected = np.linalg.solve([[a, d * cos], [d * cos, b]], [torque1, torque2])
        result = accelerations(t1, t2, w1, w2, *rod_parameters(), 0.1, -0.2)
        np.testing.assert_allclose(result, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def test_a_drive_without_motion_is_a_clamp(states):
    for state in states:
        q, w = state[:3], np.array([0.0, *state[4:]])
        driven = moved(q, w, DRIVEN, 0.0, 0.1, 0.2)
        np.testing.assert_allclose(driven, moved(q, w, CLAMPED, 0.0, 0.1, 0.2), rtol=1e-12)


@pytest.mark.slow
def test_energy_is_kinetic_plus_potential(lagrangian, states):
    for state in states:
        q, w = np.array([0.0, *state[1:3]]), np.array([0.0, *state[4:]])
        _, _, expected = lagrangian(q, w)
        assert energy(*q[1:], *w[1:], *rod_parameters()[:5]) == pytest.approx(float(expected), rel=1e-12)
