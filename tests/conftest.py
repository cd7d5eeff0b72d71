"""Fixtures that more than one package's tests use."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: tests run side by side

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from dpr_lab.rig import Rig, load_rig

settings.register_profile(
    "repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=60
)
settings.load_profile("repeatable")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20261121)


@pytest.fixture(scope="session")
def paper() -> Rig:
    return load_rig("paper")
