"""The input of a driven arm between the rows of a table: `identify` names the delay that a wrong assumption needs."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.identification.moving_arm.identify import identify_moving_arm
from dpr_lab.run import Run

pytest.importorskip("mujoco")
from tests.arm_engine import COUNT, drawn_plant, rig_of, swing

ROW = 20
"""Milliseconds between rows."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("renewed", "share"),
    [
        pytest.param("with the rows", 0.0, marks=pytest.mark.long),
        ("5 ms before", 0.25),
        pytest.param("always", 0.5, marks=pytest.mark.long),
    ],
)
def test_an_input_that_acts_before_its_rows_is_named(renewed: str, share: float) -> None:
    """A drive that renews its torque once per row, at the row or 5 ms before it, or at every millisecond."""
    rng = np.random.default_rng(5)
    plant = drawn_plant(rng, False, "", 1.0, 0.12)
    rig, runs = rig_of(plant, "driven"), []
    a = plant.rods["J1"] + plant.rods["m1"] * plant.rods["l1"] ** 2
    for number in range(2):
        t = np.arange(0, 2, 0.001)
        torque = 0.05 * np.sin(7 * t + number) + 0.03 * np.sin(11.3 * t)
        acting = torque if renewed == "always" else np.repeat(torque[::ROW], ROW)
        theta = swing(plant, np.array([0, 4.2 + 0.3 * number, 4.2 + 0.3 * number, 0, 0, 0]), t, acting)
        rows = np.arange(5 if renewed == "5 ms before" else 0, len(t), ROW)
        read = COUNT * np.round(theta[rows] / COUNT + rng.normal(0, 0.3, (len(rows), 3)))
        read[:, 2] = read[:, 1]
        runs.append(
            Run(
                name=f"r{number}", t=t[rows] - t[rows][0], theta=read, counts=None, pose=None, rig_name=rig.name,
                rig_sha256="", rate_hz=50.0, mounting="inner", arm_mode="driven", arm_input=acting[rows],
            )
        )  # fmt: skip
    warnings = " ".join(identify_moving_arm(runs, rig).warnings)
    delay = re.search(r"--input-delay-s (\S+),", warnings)
    assert (delay is None) == (share != 0.25), warnings
    assert ("--intersample continuous," in warnings) == (share == 0.5), warnings
    if share == 0.5:
        again = identify_moving_arm([replace(run, continuous=True) for run in runs], rig)
        assert again.warnings == []
        assert again.ratios["1/a"].value == pytest.approx(1 / a, rel=2e-3)
    if delay:
        assert -float(delay[1]) == pytest.approx(share * ROW / 1000, abs=1.5e-3)
        again = identify_moving_arm([replace(run, input_delay_s=float(delay[1])) for run in runs], rig)
        assert again.warnings == []
        assert again.ratios["c0/a"].value == pytest.approx(plant.c0 / a, rel=0.02)


@pytest.mark.long
def test_a_delay_of_several_rows_is_named() -> None:
    """The drive acts 24 ms after its rows of 4 ms."""
    rng, late, row = np.random.default_rng(6), 24, 4
    plant = drawn_plant(rng, False, "", 1.0, 0.12)
    rig, t = rig_of(plant, "driven"), np.arange(0, 1.5, 0.001)
    logged = np.repeat((0.05 * np.sin(7 * t) + 0.03 * np.sin(11.3 * t))[::row], row)
    theta = swing(plant, np.array([0, 4.2, 4.2, 0, 0, 0]), t, np.concatenate([np.zeros(late), logged[:-late]]))[::row]
    read = COUNT * np.round(theta / COUNT + rng.normal(0, 0.3, theta.shape))
    read[:, 2] = read[:, 1]
    run = Run(
        name="late", t=t[::row], theta=read, counts=None, pose=None, rig_name=rig.name, rig_sha256="", rate_hz=250.0,
        mounting="inner", arm_mode="driven", arm_input=logged[::row],
    )  # fmt: skip
    warnings = " ".join(identify_moving_arm([run], rig).warnings)
    delay = re.search(r"acts \S+ ms after its rows.*--input-delay-s (\S+),", warnings)
    assert delay, warnings
    assert float(delay[1]) == pytest.approx(0.024, abs=1e-3)
    assert identify_moving_arm([replace(run, input_delay_s=0.024)], rig).warnings == []
