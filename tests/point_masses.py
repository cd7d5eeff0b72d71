"""A rig with a moving arm as point masses, integrated by scipy: shares no code and no equation with the package.

A slender rod of mass m and inertia J about its centre of mass is two masses m/2 at sqrt(J/m) on either side of it. With
p the positions of all masses, M = sum m Jp^T Jp + J0 and M theta'' = sum m Jp^T (g - dJp/dt theta') + torques.
"""

import numpy as np
from scipy.integrate import solve_ivp

UP = np.array([0.0, 0.0, 1.0])


def masses_of(Z, L1):
    """Mass, rod and distance of each point mass; rod 0 is the inner rod, 1 the outer rod."""
    l1, l2, m1, m2, mb, _, _, J1, J2 = Z
    points = [(m1 / 2, 0, l1 + side * np.sqrt(J1 / m1)) for side in (-1, 1)]
    if mb:
        points.append((mb, 0, L1))
    return points + ([(m2 / 2, 1, l2 + side * np.sqrt(J2 / m2)) for side in (-1, 1)] if m2 else [])


def jacobians(theta, omega, rod, distance, L0, L1):
    """Derivative (3, 3) of a mass's position by theta, and its acceleration (3,) at constant speeds."""
    phi, *angles = theta
    w0, *speeds = omega
    radial = np.array([np.cos(phi), np.sin(phi), 0.0])
    across = np.array([-np.sin(phi), np.cos(phi), 0.0])
    along = [distance, 0.0] if rod == 0 else [L1, distance]
    reach = sum(s * np.sin(angle) for s, angle in zip(along, angles, strict=True))
    outward = sum(s * np.cos(angle) * w for s, angle, w in zip(along, angles, speeds, strict=True))
    J = np.zeros((3, 3))
    J[:, 0] = L0 * across - reach * radial
    rest = -(L0 * radial + reach * across) * w0**2 - 2 * outward * w0 * radial
    for k, (s, angle, w) in enumerate(zip(along, angles, speeds, strict=True)):
        J[:, 1 + k] = s * (np.cos(angle) * across - np.sin(angle) * UP)
        rest = rest - s * w**2 * (np.sin(angle) * across + np.cos(angle) * UP)
    return J, rest


def accelerations(x, torque, Z, arm, frame):
    """Accelerations theta'' (3,) at the state x (6,), under a torque on the arm."""
    L0, L1, g = frame
    theta, omega = x[:3], x[3:]
    M = np.diag([arm.J0, 0.0, 0.0])
    c1, c2 = Z[5:7]
    f = np.array([
        torque - arm.c0 * omega[0] - arm.k0 * theta[0],
        -c1 * omega[1] - c2 * (omega[1] - omega[2]),
        -c2 * (omega[2] - omega[1]),
    ])  # fmt: skip
    for mass, rod, distance in masses_of(Z, L1):
        J, rest = jacobians(theta, omega, rod, distance, L0, L1)
        M += mass * J.T @ J
        f += mass * J.T @ (-g * UP - rest)
    if not Z[3]:
        M[2, 2], f[2] = 1.0, 0.0  # no outer rod
    return np.linalg.solve(M, f)


def point_masses(Z, arm, start, t, push, frame):
    """Simulate angles (n, 3) of a swing at the instants t, with a torque on the arm that is held between them."""
    x, theta = np.asarray(start, dtype=float), np.empty((len(t), 3))
    for i, torque in enumerate(push):
        theta[i] = x[:3]
        if i + 1 < len(t):
            rates = lambda _, x, u=torque: np.concatenate([x[3:], accelerations(x, u, Z, arm, frame)])  # noqa: E731
            x = solve_ivp(rates, t[i : i + 2], x, method="RK45", rtol=1e-9, atol=1e-10).y[:, -1]
    return theta
