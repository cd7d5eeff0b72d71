"""Compliant mount, compared with an engine that integrates rods and mount together."""

import math

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.errors import ConfigError
from sim_device.plant.config import MountConfig, load_plant
from sim_device.plant.hidden import plant_of
from tests.background_rigs import Mount, swing

RATE_HZ = 200.0


def on_mount(paper, **mount):
    plant = load_plant("paper")
    return plant_of(plant.model_copy(update={"mount": MountConfig(**mount) if mount else None}), paper)


@pytest.mark.slow
@pytest.mark.parametrize(("stiffness", "frequency_hz", "damping"), [(1e5, 15.0, 0.05), (2e5, 40.0, 0.02)])
def test_the_rods_follow_an_engine_that_couples_them_to_the_mount(paper, stiffness, frequency_hz, damping):
    theta = np.array([0.0, *paper.poses["X1"].theta[1:]])
    t = np.arange(301) / RATE_HZ
    rigid, soft = (
        on_mount(paper, **mount).let_go(theta, np.zeros(3), RATE_HZ, 1).theta(0, len(t))[:, 1:]
        for mount in ({}, {"stiffness_N_per_m": stiffness, "frequency_hz": frequency_hz, "damping_ratio": damping})
    )
    base = base_parameters(load_plant("paper").Z, paper.L1, paper.g)
    mount = Mount(stiffness, 2 * math.pi * frequency_hz, damping)
    start = np.append(theta[1:], [0.0, 0.0])
    both, alone = (swing(base, paper, (), start, t, 2, one)[:, :2] for one in (mount, None))
    moved = both - alone
    assert np.abs(moved).max() > 1e-5
    assert np.sqrt(np.mean((soft - rigid - moved) ** 2)) < 0.05 * np.sqrt(np.mean(moved**2))


def test_drives_and_foreign_effects_have_no_mount(paper):
    yielding = {"stiffness_N_per_m": 1e5, "frequency_hz": 20.0}
    with pytest.raises(ConfigError, match="rigid mount"):
        on_mount(paper, **yielding).refuse_drives()
    foreign = load_plant("paper").model_copy(
        update={"mount": MountConfig(**yielding), "foreign": {"loose_bearing": {}}}
    )
    with pytest.raises(ConfigError, match="cannot be combined"):
        plant_of(foreign, paper)
