"""E(Z) compared with SciPy's DOP853 and with docs/theory.md equation (1), implemented separately."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.paper.printed import TABLE_1, TABLE_2, TRUE
from dpr_lab.paper.swings import INSTANTS, READINGS, errors, objective, swings
from dpr_lab.paper.tables import recompute, table1, table2
from dpr_lab.rig import PARAMETERS, Rig

L1, G = 0.4, 9.81


def independent(Z: NDArray[np.float64], theta1: float, theta2: float) -> NDArray[np.float64]:
    l1, l2, m1, m2, mb, c1, c2, J1, J2 = Z

    def slope(_t: float, state: NDArray[np.float64]) -> list[float]:
        t1, t2, w1, w2 = state
        coupling = m2 * L1 * l2 * np.cos(t1 - t2)
        mass = [[J1 + m1 * l1**2 + (m2 + mb) * L1**2, coupling], [coupling, J2 + m2 * l2**2]]
        swirl = m2 * L1 * l2 * np.sin(t1 - t2)
        torque = [
            -swirl * w2**2 - c1 * w1 - c2 * (w1 - w2) + (m1 * l1 + (m2 + mb) * L1) * G * np.sin(t1),
            swirl * w1**2 - c2 * (w2 - w1) + m2 * l2 * G * np.sin(t2),
        ]
        return [w1, w2, *np.linalg.solve(mass, torque)]

    solved = solve_ivp(slope, (0, 10), [theta1, theta2, 0, 0], method="DOP853", t_eval=INSTANTS, rtol=1e-9, atol=1e-10)
    return solved.y.T


@pytest.mark.slow
def test_table_1_agrees_with_an_independent_integrator(paper: Rig):
    ours = recompute(paper).table1
    true = independent(TRUE, np.pi, 0.1)
    for row in (1, 2, 5):
        error = independent(TABLE_1[row, :9], np.pi, 0.1) - true
        assert ours["angles"][row, 0] == pytest.approx(np.sum(error[:, :2] ** 2), rel=1e-3)
        assert ours["angles and speeds"][row, 0] == pytest.approx(np.sum(error**2), rel=1e-3)
        relative = np.sum(error[:, 0] ** 2) + np.sum((error[:, 1] - error[:, 0]) ** 2)
        assert ours["relative angles"][row, 0] == pytest.approx(relative, rel=1e-3)


def test_table_2_takes_its_rows_from_table_1(paper: Rig):
    ours = recompute(paper)
    E = ours.table1["angles"]
    shown = [float(row[3]) for row in table2(ours).rows]
    groups = [int(group) - 1 for group in TABLE_2[:, 0]]
    np.testing.assert_allclose(shown, E[groups].ravel(), rtol=1e-3)
    np.testing.assert_allclose([float(row[2]) for row in table1(ours).rows], E[:, 0], rtol=1e-3)


@pytest.mark.parametrize("name", READINGS)
def test_the_search_minimises_the_error_that_is_reported(name: str, paper: Rig):
    truth, reading = swings(TRUE, paper), READINGS[name]
    Z = TRUE * np.linspace(0.97, 1.03, 9)
    term = "angles and speeds" if reading.speeds else "angles"
    E = errors(Z, truth, paper)[term][: len(reading.poses)]
    batch = objective(reading, truth, paper)(np.stack([Z, TRUE]))
    assert batch[0, 0] == pytest.approx(E[0], rel=1e-6)  # X1; chaos multiplies the last bits of the other poses
    assert batch[0] == pytest.approx(E, rel=0.05)
    assert batch[1].max() < 1e-6


def test_masses_on_another_scale_swing_alike(paper: Rig):
    truth = swings(TRUE, paper)
    heavier = TRUE * np.where([name.startswith("l") for name in PARAMETERS], 1.0, 1.1)
    assert errors(heavier, truth, paper)["angles"].max() < 1e-6
