"""Recordings of a simulated rig whose truth the tests know; the plant integrates ten times finer than the lab."""

from collections.abc import Callable, Mapping

import pytest

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.diagnosis import Diagnosis
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from sim_device.config import Encoders, PlantConfig, load_plant
from sim_device.direct import record

Effects = Mapping[str, Mapping[str, float]]
Recorded = Callable[..., list[Run]]


@pytest.fixture(scope="session")
def recorded(paper: Rig) -> Recorded:
    """(effects, seed, duration, encoders) -> one run from each pose."""

    def made(effects: Effects, seed: int = 1, duration: float = 5.0, **encoders: object) -> list[Run]:
        plant = load_plant("paper", seed)
        config = PlantConfig.model_validate(
            plant.model_dump() | {"effects": effects, "encoders": Encoders.model_validate(encoders)}
        )
        return record(config, paper, duration)

    return made


@pytest.fixture(scope="session")
def two_effects() -> Effects:
    return {"coulomb_joint1": {"torque_Nm": 1.5e-3}, "latency_joint2": {"delay_s": 5e-4}}


@pytest.fixture(scope="session")
def two_runs(recorded: Recorded, two_effects: Effects) -> list[Run]:
    return recorded(two_effects)


@pytest.fixture(scope="session")
def two_found(two_runs: list[Run], paper: Rig) -> Diagnosis:
    return diagnose(two_runs, paper)
