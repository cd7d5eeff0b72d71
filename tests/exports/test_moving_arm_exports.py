"""Models with a moving arm in other programs move as in the lab, and as the rig did."""

import json
import runpy
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from dpr_lab.cli.app import app
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS, arm_segments, swing_segments
from dpr_lab.errors import ConfigError
from dpr_lab.exports.moving_arm.formats import ARM_FORMATS
from dpr_lab.identification.model import EstimatedValue, RigFacts
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import load_rig
from tests.identification.test_moving_arm_fit import rig_with

T = np.arange(0, 1.0, 0.005)
PUSH = 0.6 * np.sin(4 * T)
START = np.array([0.1, 2.4, 3.5, 0.2, -0.1, 0.3])


def model_of(rods="both", kind="torque", **changed):
    """A model by values; of its other fields no export reads any."""
    rig = rig_with("driven", kind, rods)
    rods_of = {"both": (0.038, 0.0053, 0.008, 0.9, 1e-3, 1e-3), "inner": (0.0053, 0.0053, 0.0, 0.2, 1e-3, 0.0)}
    values = dict(zip(SWING_PARAMETERS, (*rods_of[rods], 0.06, 0.02, 0.3, 0.0, 0.5, rig.L0), strict=True)) | changed
    scale = "b" if rods == "both" else "a"
    swing = [value if name == "L0" else value / values[scale] for name, value in values.items()]
    one = EstimatedValue(value=values[scale], std=1e-5, interval90=(values[scale], values[scale]), fixed_by="data")
    ratios = dict.fromkeys([f"{name}/{scale}" for name in ("e1", "A", "c0")], one)
    return rig, MovingArmModel.model_construct(
        rig=RigFacts.model_construct(name='a "rig"', sha256="", L1=rig.L1, g=rig.g),
        mounted=rods, input=kind, scale=scale, ratios=ratios, absolute={scale: one}, swing=swing,
        scale_sentence="The scale is <known>.",
    )  # fmt: skip


def lab(rig, model, start, push=PUSH):
    segments = arm_segments([T], [1], [push], 5e-4)
    return swing_segments(model.swing, (rig.L1, rig.g), segments, start[None])[:, :3]


def replayed(name, rig, model, folder: Path, start):
    chosen = ARM_FORMATS[name]
    content = chosen.content(model, rig)
    file = folder / chosen.main
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return chosen.replay(file, model, rig)(start, T, PUSH)


@pytest.mark.parametrize("rods", ["both", "inner"])
@pytest.mark.parametrize(("name", "near"), [("python", 1e-9), ("mjcf", 1e-8), ("sdf", 1e-8)])
def test_a_program_moves_as_the_lab_does(name, near, rods, tmp_path):
    rig, model = model_of(rods)
    start = START if rods == "both" else START * [1, 1, 0, 1, 1, 0]
    assert np.abs(replayed(name, rig, model, tmp_path, start) - lab(rig, model, start)).max() < near


def test_urdf_moves_as_the_lab_does_without_a_spring(tmp_path):
    rig, model = model_of(k0=0.0)
    assert np.abs(replayed("urdf", rig, model, tmp_path, START) - lab(rig, model, START)).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fmu", "fmu2"])
def test_a_unit_moves_as_the_lab_does_under_its_input(name, tmp_path):
    rig, model = model_of()
    assert np.abs(replayed(name, rig, model, tmp_path, START) - lab(rig, model, START)).max() < 1e-9


def test_dry_friction_of_the_arm_is_frictionloss_of_its_hinge(tmp_path):
    rig, model = model_of(f0=0.05)
    away = np.abs(replayed("mjcf", rig, model, tmp_path, START) - lab(rig, model, START)).max()
    without = np.abs(lab(rig, model_of()[1], START) - lab(rig, model, START)).max()
    assert away < 0.05 * without


def test_the_motor_takes_the_input_in_its_own_unit(tmp_path):
    rig, model = model_of(kind="voltage")
    replayed("mjcf", rig, model, tmp_path, START)
    engine = mujoco.MjModel.from_xml_path(str(tmp_path / "corrected_model.xml"))
    assert engine.actuator("arm_voltage").gear[0] == pytest.approx(0.5)
    assert [engine.joint(j).name for j in range(3)] == ["joint0", "joint1", "joint2"]


def test_an_arm_whose_inertia_is_unknown_is_no_body():
    rig, model = model_of()
    model = model.model_copy(update={"ratios": {}})
    with pytest.raises(ConfigError, match="do not determine the inertia of the arm"):
        ARM_FORMATS["mjcf"].content(model, rig)
    assert "simulate" in str(ARM_FORMATS["python"].content(model, rig))


def test_export_checks_a_captured_run(tmp_path):
    from dpr_lab.storage.csv_import import import_csv
    from dpr_lab.storage.tables.options import ImportOptions

    rig, model = model_of("inner", "current")
    rig_file = tmp_path / "rig.toml"
    text = load_rig("paper").path.read_text() + '\n[rods]\nmounted = "inner"\n[arm]\nmode = "driven"\n'
    rig_file.write_text(text + 'A = {nominal = 0.06, lower = 0.01, upper = 1.0}\n[motor]\ninput = "current"\n')
    start = np.array([0.0, 2.4, 0.0, 0.0, 0.0, 0.0])
    angles = lab(rig, model, start, 2 * PUSH) + np.random.default_rng(1).normal(0, 3e-4, (len(T), 3))
    rows = np.column_stack([T, angles[:, :2], 2 * PUSH])
    table = tmp_path / "swing.csv"
    np.savetxt(table, rows, delimiter=",", header="t,theta0,theta1,current", comments="", fmt="%.9f")
    run = tmp_path / "swing.mcap"
    import_csv(table, load_rig(rig_file), ImportOptions(keep_rest=True), out=run)
    fitted = CliRunner().invoke(app, ["identify", str(run), "--rig", str(rig_file), "--out", str(tmp_path / "m.json")])
    assert fitted.exit_code == 0, fitted.output
    out = tmp_path / "export"
    args = ["export", str(tmp_path / "m.json"), "--rig", str(rig_file), "--to", "mjcf,python", "--check", str(run)]
    done = CliRunner().invoke(app, [*args, "--out", str(out), "--json"])
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert set(result["files"]) == {"mjcf", "python"}
    assert result["error_rad"]["mjcf"] == pytest.approx(result["own_rad"], rel=1e-3)
    assert max(result["away_rad"].values()) < 1e-6
    assert runpy.run_path(str(out / "corrected_model.py"))["INPUT"] == "current"
