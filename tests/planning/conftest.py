"""Two effects, recorded and diagnosed once for all tests."""

from collections.abc import Callable, Mapping

import pytest

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Effects = Mapping[str, Mapping[str, float]]
Recorded = Callable[..., list[Run]]


@pytest.fixture(scope="session")
def two_effects() -> Effects:
    return {"coulomb_joint1": {"torque_Nm": 1.5e-3}, "latency_joint2": {"delay_s": 5e-4}}


@pytest.fixture(scope="session")
def two_runs(recorded: Recorded, two_effects: Effects) -> list[Run]:
    return recorded(two_effects)


@pytest.fixture(scope="session")
def two_found(two_runs: list[Run], paper: Rig) -> Diagnosis:
    return diagnose(two_runs, paper)
