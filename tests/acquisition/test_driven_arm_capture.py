"""Capture and identification of a Furuta pendulum with a driven arm, including the motor's voltage."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.acquisition.capture import CaptureOptions, capture
from dpr_lab.acquisition.conformance import ConformanceSettings, conformity
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.errors import ConfigError, LinkError
from dpr_lab.identification.moving_arm.identify import identify_moving_arm
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.inspect import info
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from sim_device.plant.config import load_plant
from tests.thinned import thinned

OPTIONS = CaptureOptions(duration=2.0, pose_timeout=60.0, rest_timeout=60.0)
FURUTA = {"rig": "furuta", "plant": "furuta"}


@pytest.fixture
def furuta() -> Rig:
    return load_rig("furuta")


def changed(tmp_path: Path, old: str, new: str) -> Path:
    """Copy of the plant file with another line."""
    text = (Path(__file__).parents[2] / "configs/plants/furuta.toml").read_text()
    assert old in text
    file = tmp_path / "plant.toml"
    file.write_text(text.replace(old, new))
    return file


def test_an_arm_that_moves_although_it_is_described_as_clamped_is_noted(
    furuta: Rig, tmp_path: Path, bench, agree
) -> None:
    clamped = furuta.model_copy(update={"arm": furuta.arm.model_copy(update={"mode": "clamped"})})
    with bench(**FURUTA) as (device, _):
        captured = capture(device, clamped, "X1", replace(OPTIONS, duration=0.5), tmp_path, confirm=agree)
    assert "described as clamped, but encoder 0 turns by" in captured.quality.sentence
    assert any("state its mode" in note for note in load_run(captured.run_file).notes)


@pytest.mark.slow
@pytest.mark.parametrize("firmware", thinned(["python", "c"], 2))
def test_a_captured_run_identifies_rod_arm_and_motor(furuta: Rig, tmp_path: Path, bench, agree, firmware: str) -> None:
    runs = []
    for pose in ("X1", "X2"):
        with bench(**FURUTA, firmware=firmware) as (device, spy):
            captured = capture(device, furuta, pose, OPTIONS, tmp_path / pose, confirm=agree)
            assert max(spy.sent) <= 39  # no command that moves a drive
            assert device.info.input_unit == 100
        assert captured.quality.ok, captured.quality.sentence
        runs.append(load_run(captured.run_file, furuta))
    t, voltage = runs[0].swing.t, runs[0].swing.arm_input
    expected = 2 * (np.sin(2 * np.pi * 0.7 * t) + np.sin(2 * np.pi * 1.9 * t))
    assert voltage == pytest.approx(expected, abs=1e-4)
    assert runs[0].arm_mode == "driven"
    assert runs[0].torques is None
    model, plant = identify_moving_arm(runs, furuta), load_plant("furuta")
    of_rod, arm, drive = plant.parameters, plant.arm, plant.arm_drive
    assert drive is not None
    a = of_rod["J1"] + of_rod["m1"] * of_rod["l1"] ** 2
    truth = {
        "e1/a": of_rod["m1"] * of_rod["l1"] * 9.81 / a,
        "A/a": (arm.J0 + (of_rod["m1"] + of_rod["mb"]) * furuta.L0**2) / a,
        "c0/a": (arm.c0 + drive.ke * drive.kt / drive.R) / a,
        "kt/(R a)": drive.kt / drive.R / a,
    }
    assert not model.failures
    for name, value in truth.items():
        assert model.ratios[name].value == pytest.approx(value, abs=4 * model.ratios[name].std, rel=1e-9), name
        assert model.ratios[name].std < 1e-3 * value


@pytest.mark.slow
def test_inputs_clipped_by_the_driver_are_stored_as_commanded_not_measured(
    furuta: Rig, tmp_path: Path, bench, agree
) -> None:
    plant = changed(tmp_path, "limit = 10.0", "limit = 2.5")
    with bench(rig="furuta", plant=plant) as (device, _):
        captured = capture(device, furuta, "X1", OPTIONS, tmp_path, confirm=agree)
    run = load_run(captured.run_file, furuta)
    assert run.arm_input is not None
    assert np.abs(run.arm_input).max() == pytest.approx(2.5)
    commanded = run.driven_by("commanded")
    assert (run.torque_kind, commanded.torque_kind, commanded.both_kinds) == ("measured", "commanded", False)
    assert commanded.arm_input is not None
    assert np.abs(commanded.arm_input).max() > 3.0
    assert run.driven_by("measured").arm_input is run.arm_input
    assert run.between(0.0, 1.0).commanded_input is not None
    model = identify_moving_arm([run], furuta)
    assert model.fit.chi2_per_dof < 1.2


@pytest.mark.slow
def test_lost_inputs_are_counted_and_not_interpolated(furuta: Rig, tmp_path: Path, bench, agree) -> None:
    with bench(**FURUTA, fault=("lose_torques=0.02",)) as (device, _):
        captured = capture(device, furuta, "X1", OPTIONS, tmp_path, confirm=agree)
    run = load_run(captured.run_file, furuta)
    assert run.lost["torque"] > 20
    assert identify_moving_arm([run], furuta).fit.chi2_per_dof < 1.2


def test_an_input_that_contradicts_the_rig_file_is_refused(furuta: Rig, tmp_path: Path, bench, agree) -> None:
    table = furuta.model_dump(exclude_none=True) | {"motor": {"input": "current"}}
    with bench(**FURUTA) as (device, _), pytest.raises(ConfigError, match=r"input is current.*reports a voltage"):
        capture(device, Rig.model_validate(table), "X1", OPTIONS, tmp_path, confirm=agree)


def test_a_plant_whose_arm_is_driven_needs_its_drive(tmp_path: Path, bench) -> None:
    plant = changed(tmp_path, 'mode = "driven"', 'mode = "free"')
    with pytest.raises((LinkError, ConfigError), match="require each other"), bench(rig="furuta", plant=plant):
        pass


@pytest.mark.long
@pytest.mark.parametrize("program", thinned(["chirp", "prbs"], 2))
def test_other_programs_excite_the_arm_too(furuta: Rig, tmp_path: Path, bench, agree, program: str) -> None:
    plant = changed(tmp_path, "amplitude = 4.0", f'program = "{program}"\namplitude = 4.0')
    with bench(rig="furuta", plant=plant) as (device, _):
        captured = capture(device, furuta, "X1", OPTIONS, tmp_path, confirm=agree)
    model = identify_moving_arm([load_run(captured.run_file, furuta)], furuta)
    assert model.fit.chi2_per_dof < 1.2
    assert model.ratios["kt/(R a)"].std < 1e-2 * model.ratios["kt/(R a)"].value


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("firmware", ["python", "c"])
def test_a_device_whose_arm_has_a_drive_conforms(simulated, firmware: str) -> None:
    """In `tests/firmware_c/test_c_traces.py`, both implementations run every exchange without waiting."""
    link = open_transport(simulated(**FURUTA, clock="realtime", firmware=firmware).url)
    try:
        patient = ConformanceSettings(patience_s=60.0, rate_off=0.5, reports_hz=(1.0, 30.0))
        answers = list(conformity(link, replace(patient, rate_hz=500)))
    finally:
        link.close()
    assert [(one.what, one.message) for one in answers if not one.ok] == []
    assert any("with a drive of the arm reports it first" in one.what for one in answers)
    assert {"every sample has its torques"} < {one.what for one in answers}


@pytest.mark.slow
def test_a_free_arm_with_both_rods_is_captured_and_identified(tmp_path: Path, bench, agree) -> None:
    table = load_rig("paper").model_dump(exclude_none=True)
    table["arm"] = {"mode": "free", "A": {"nominal": 0.1, "lower": 0.01, "upper": 1.0}}
    rig = Rig.model_validate(table)
    text = (Path(__file__).parents[2] / "configs/plants/arm.toml").read_text()
    plant = tmp_path / "plant.toml"
    plant.write_text(text.replace("k0 = 400.0", "k0 = 0.0"))
    with bench(plant=plant) as (device, _):
        captured = capture(device, rig, "X1", OPTIONS, tmp_path, confirm=agree)
    assert captured.quality.ok, captured.quality.sentence
    run = load_run(captured.run_file, rig)
    assert run.arm_mode == "free"
    assert run.arm_input is None
    model, config = identify_moving_arm([run], rig), load_plant(plant)
    base = base_parameters(config.Z, rig.L1, rig.g)
    total = config.arm.J0 + config.Z[2:5].sum() * rig.L0**2
    for name, value in (("a/b", base[0]), ("d/b", base[2]), ("A/b", total), ("c0/b", config.arm.c0)):
        estimate = model.ratios[name]
        assert estimate.value == pytest.approx(value / base[1], abs=4 * estimate.std), name


@pytest.mark.long
def test_the_driven_double_pendulum_is_captured_and_identified(tmp_path: Path, bench, agree) -> None:
    rig = load_rig("driven_double")
    with bench(rig="driven_double", plant="driven_double") as (device, _):
        captured = capture(device, rig, "X1", OPTIONS, tmp_path, confirm=agree)
    assert captured.quality.ok, captured.quality.sentence
    model, config = identify_moving_arm([load_run(captured.run_file, rig)], rig), load_plant("driven_double")
    assert not model.failures
    base = base_parameters(config.Z, rig.L1, rig.g)
    total = config.arm.J0 + config.Z[2:5].sum() * rig.L0**2
    drive = config.arm_drive
    assert drive is not None
    truth = {"a/b": base[0], "d/b": base[2], "e1/b": base[3], "A/b": total, "kt/b": drive.gear * drive.kt}
    for name, value in truth.items():
        estimate = model.ratios[name]
        assert estimate.value == pytest.approx(value / base[1], abs=4 * estimate.std), name
    assert model.absolute["b"].value == pytest.approx(base[1], rel=0.05)  # kt of the rig file is 1 % off
    assert "kt/b contains the gear ratio 5." in model.notes
    about = info(captured.run_file)
    assert (about.arm, about.inner, about.input) == ("driven", "free", "measured current")
