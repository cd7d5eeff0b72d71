"""Corrected model as an FMU, run by FMPy."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import fmpy
import numpy as np
import pytest

from dpr_lab.exports.fmu import fmu
from dpr_lab.exports.python_module import python_module
from dpr_lab.rig import Rig
from tests.exports.models import SETS, X0, lab_states, model_of, run_source, typical

OUTPUTS = ["theta1", "theta2", "omega1", "omega2", "encoder1", "encoder2"]


def simulate(path: Path, **settings) -> np.ndarray:
    """In a process of its own: a unit that embeds Python is not unloaded cleanly from a Python process."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(fmpy.simulate_fmu, str(path), **settings).result()


@pytest.fixture(scope="module", params=["3.0", pytest.param("2.0", marks=pytest.mark.long)])
def standard(request) -> str:
    return request.param


@pytest.fixture(scope="module")
def unit(paper: Rig, standard: str, tmp_path_factory) -> tuple[Path, dict]:
    chosen = {name: values for effect in (*SETS[0], *SETS[2]) for name, values in typical(effect).items()}
    folder = tmp_path_factory.mktemp("fmu")
    path = folder / "corrected_model.fmu"
    path.write_bytes(fmu(model_of(paper, chosen, 'a "rig"\n'), paper, standard))
    return path, chosen


@pytest.mark.slow
def test_the_fmu_declares_its_inputs_and_outputs(unit, standard: str):
    described = fmpy.read_model_description(str(unit[0]), validate=True)
    assert described.fmiVersion == standard
    assert described.coSimulation is not None
    causality = {variable.name: variable.causality for variable in described.modelVariables}
    assert [name for name, what in causality.items() if what == "input"] == ["torque1", "torque2"]
    assert [name for name, what in causality.items() if what == "output"] == OUTPUTS
    described_as = {variable.name: variable.description for variable in described.modelVariables}
    assert described_as["omega2_start"] == "initial angular velocity, rad/s"
    if standard == "3.0":  # pythonfmu has no units
        units = {variable.name: variable.unit for variable in described.modelVariables}
        assert [units[name] for name in ("torque1", *OUTPUTS)] == ["N.m", *2 * ["rad"], *2 * ["rad/s"], *2 * ["rad"]]
        assert {unit.name for unit in described.unitDefinitions} >= set(filter(None, units.values()))


def start_values(x0):
    return dict(zip(("theta1_start", "theta2_start", "omega1_start", "omega2_start"), x0, strict=True))


@pytest.mark.slow
def test_motion_and_readings_of_the_fmu_agree_with_dpr_lab(unit, paper: Rig):
    path, chosen = unit
    output = simulate(
        path, stop_time=1.0, step_size=0.01, output_interval=0.01, output=OUTPUTS, start_values=start_values(X0)
    )
    t = output["time"].copy()  # contiguous: for a field of records the integration would be compiled once more
    states = np.column_stack([output[name] for name in OUTPUTS[:4]])
    assert states == pytest.approx(lab_states(paper, chosen, t), abs=1e-9)
    module = run_source(python_module(model_of(paper, chosen), paper), path.parent)
    read = module["readings"](X0, t)
    assert np.column_stack([output["encoder1"], output["encoder2"]]) == pytest.approx(read, abs=1e-6)


@pytest.mark.slow
def test_the_fmu_takes_torques(unit, paper: Rig):
    path, chosen = unit
    signals = np.array([(0.0, 0.2, -0.1), (0.5, 0.2, -0.1)], dtype=[(n, float) for n in ("time", "torque1", "torque2")])
    output = simulate(
        path, stop_time=0.5, step_size=0.01, output_interval=0.01, input=signals, output=OUTPUTS,
        start_values=start_values(X0),
    )  # fmt: skip
    module = run_source(python_module(model_of(paper, chosen), paper), path.parent)
    states = module["simulate"](X0, output["time"], torques=lambda t, state: (0.2, -0.1))
    assert np.column_stack([output[name] for name in OUTPUTS[:4]]) == pytest.approx(states, abs=1e-9)
    assert np.abs(states - module["simulate"](X0, output["time"])).max() > 0.1
