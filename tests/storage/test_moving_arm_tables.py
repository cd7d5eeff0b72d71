"""A table of a driven arm becomes a run, is identified and compared on the command line."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from dpr_lab.cli.app import app
from dpr_lab.dynamics.arm import ArmParameters
from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.export import export
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.understand import understand
from tests.whole_swing import simulate_arm

RIG = """
[arm]
mode = "driven"
A = {nominal = 0.08, lower = 0.01, upper = 1.0}

[motor]
input = "current"
kt = {nominal = 0.5, measured = 0.5, std = 0.005}
"""


@pytest.fixture
def rig_file(tmp_path):
    file = tmp_path / "rig.toml"
    builtin = load_rig("paper").path
    assert builtin is not None
    file.write_text(builtin.read_text() + RIG)
    return file


@pytest.fixture
def table(tmp_path, rig_file):
    rig = load_rig(rig_file)
    t = np.arange(0, 4, 0.005)
    current = 1.2 * np.sin(4 * t) + np.sin(7.3 * t + 1)
    arm = ArmParameters(J0=0.02, c0=0.02, mode="free")
    start = [0, np.pi - 0.8, np.pi + 0.4, 0, 0, 0]
    x = simulate_arm(rig.nominal, (rig.L0, rig.L1, rig.g), arm, start, t, drive=0.5 * current)
    angles = x[:, :3] + np.random.default_rng(1).normal(0, 3e-4, (len(t), 3))
    file = tmp_path / "swing.csv"
    np.savetxt(file, np.column_stack([t, angles, 1e3 * current]), delimiter=",", fmt="%.7f",
               header="t,theta0,theta1,theta2,motor_current_mA", comments="")  # fmt: skip
    return file


def test_the_input_of_a_driven_arm_is_kept_with_the_run(tmp_path, rig_file, table):
    rig = load_rig(rig_file)
    made = import_csv(table, rig)
    run = import_csv(table, rig, out=tmp_path / "run.mcap")
    assert (run.arm_mode, run.torques) == ("driven", None)
    assert run.arm_input is not None
    assert np.allclose(run.arm_input[:3], 1.2 * np.sin(4 * run.t[:3]) + np.sin(7.3 * run.t[:3] + 1), atol=1e-6)
    assert run.readings_sha256 == made.readings_sha256
    first = load_run(tmp_path / "run.mcap").only(run.t < 1).arm_input
    assert first is not None
    assert first.shape == (np.sum(run.t < 1),)


def test_the_input_of_a_driven_arm_is_no_torque_on_the_rods(rig_file, table):
    rig_file.write_text(rig_file.read_text().replace("= 0.5,", "= 0.005,").replace("std = 0.005", "std = 0.0005"))
    t, theta0, theta1, theta2, current = np.loadtxt(table, delimiter=",", skiprows=1).T
    large = np.column_stack([t, theta0, theta1, theta2, 0.1 * current])  # mA to A, 100 times
    np.savetxt(table, large, delimiter=",", fmt="%.7f", header="t,theta0,theta1,theta2,u", comments="")
    assert understand(table, load_rig(rig_file), ImportOptions()).questions == ()
    assert any("driven by the current in column u" in note for note in import_csv(table, load_rig(rig_file)).notes)


def test_an_input_without_its_constant_is_noted_at_the_import(rig_file, table):
    assert not any(
        "the torque per current is therefore fitted" in note for note in import_csv(table, load_rig(rig_file)).notes
    )
    rig_file.write_text(rig_file.read_text().replace("kt = {", "# kt = {"))
    assert any(
        "has no kt: the torque per current is therefore fitted" in n
        for n in import_csv(table, load_rig(rig_file)).notes
    )


@pytest.mark.parametrize(("factor", "stated", "named"), [(180 / np.pi, "rad", "deg"), (1.0, "deg", "rad")])
def test_angles_of_a_moving_arm_in_another_unit_are_named(tmp_path, rig_file, table, factor, stated, named):
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    rows[:, 1:4] *= factor
    other = tmp_path / "other.csv"
    np.savetxt(other, rows, delimiter=",", header=table.read_text().splitlines()[0], comments="")
    rig = load_rig(rig_file)
    assert not understand(table, rig, ImportOptions()).questions
    questions = understand(other, rig, ImportOptions(unit=stated)).questions
    assert questions[0].mend == ("--unit", named)
    assert f"if the angles are in {named}" in questions[0].sentence


@pytest.mark.parametrize(
    ("columns", "mend"),
    [((1,), "theta0=0.0174533"), ((2, 3), "theta1=0.0174533,theta2=0.0174533")],
)
def test_degrees_of_the_arm_or_the_rods_alone_are_named(tmp_path, rig_file, table, columns, mend):
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    rows[:, columns] *= 180 / np.pi
    other = tmp_path / "other.csv"
    np.savetxt(other, rows, delimiter=",", header=table.read_text().splitlines()[0], comments="")
    (question,) = understand(other, load_rig(rig_file), ImportOptions(unit="rad")).questions
    assert question.mend == ("--scale", mend)


def test_an_exported_run_with_a_driven_arm_is_imported_again(tmp_path, rig_file, table):
    rig = load_rig(rig_file)
    run = import_csv(table, rig, out=tmp_path / "run.mcap")
    again = import_csv(export(load_run(tmp_path / "run.mcap"), tmp_path / "run.csv"), rig)
    assert run.arm_input is not None
    assert again.arm_input == pytest.approx(run.arm_input)
    assert np.allclose(again.theta, run.theta)


@pytest.mark.slow
def test_an_override_and_what_it_lacks(rig_file, table):
    rig = load_rig(rig_file)
    assert import_csv(table, rig, ImportOptions(arm="clamped")).arm_mode == "clamped"
    assert import_csv(table, rig, ImportOptions(arm="free")).arm_input is None
    with pytest.raises(RunError, match="no column is named 'amps'"):
        import_csv(table, rig, ImportOptions(columns={"input": "amps"}))
    text = table.read_text()
    table.write_text(text.replace("motor_current_mA", "Im_mA"))
    assert import_csv(table, rig).arm_input is not None
    table.write_text(text.replace("motor_current_mA", "motor_voltage"))
    with pytest.raises(RunError, match=r"current that drives .* not found: .*set input = \"voltage\" in \[motor\]"):
        import_csv(table, rig)
    table.write_text(text.replace("theta0", "shoulder"))
    with pytest.raises(RunError, match="a driven arm needs its angle"):
        import_csv(table, rig)


@pytest.mark.long
def test_from_a_table_to_a_comparison(tmp_path, rig_file, table):
    runs, model = tmp_path / "runs", tmp_path / "model.json"
    read_in = CliRunner().invoke(app, ["import", "table", str(table), "--rig", str(rig_file), "--out", str(runs)])
    assert read_in.exit_code == 0, read_in.output
    swing = str(runs / "swing.mcap")
    fitted = CliRunner().invoke(app, ["identify", swing, "--rig", str(rig_file), "--out", str(model)])
    assert fitted.exit_code == 0, fitted.output
    identified = json.loads(model.read_text())
    truth = load_rig(rig_file).nominal
    assert abs(identified["absolute"]["b"]["value"] / (truth[8] + truth[3] * truth[1] ** 2) - 1) < 0.02
    out = tmp_path / "report"
    done = CliRunner().invoke(app, ["compare", swing, "--model", str(model), "--out", str(out), "--json"])
    (compared,) = json.loads(done.stdout)["runs"]
    assert not compared["held_out"]
    assert all(compared["rms_rad"][joint] < 1.5 * compared["noise_rad"][joint] for joint in compared["rms_rad"])
    assert (out / "comparison.csv").read_text().count("\n") == len(load_run(swing).swing.t) + 1
