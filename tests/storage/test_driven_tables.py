"""Known torques from a table to a run file and back, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.estimation.arm_motion import arm_motion
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import RigGeometry
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.export import export
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.tables.understand import understand
from dpr_lab.storage.writer import RunWriter
from dpr_lab.tui.steps.table_options import parse_options
from dpr_lab.workflows.events import RunRead
from dpr_lab.workflows.reading import read_runs

T = np.arange(0, 1, 0.01)
ANGLES = np.column_stack([T, np.cos(6 * T), np.cos(8 * T)])
TAU = np.column_stack([np.sin(5 * T), 0.1 + 0 * T])


@pytest.fixture(autouse=True)
def without_doubts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The angles do not follow from these torques; a search for the cause (`test_questions.py`) takes seconds."""
    monkeypatch.setattr("dpr_lab.storage.tables.understand.questions", lambda _: [])


def table(folder: Path, header: str, *columns: np.ndarray) -> Path:
    file = folder / "driven.csv"
    np.savetxt(
        file, np.column_stack([ANGLES, *columns]), delimiter=",", header=f"t,theta1,theta2,{header}", comments=""
    )
    return file


@pytest.mark.parametrize("header", ["tau1_Nm,tau2_Nm", "torque1,torque2", "tau1_measured_Nm,tau2_measured_Nm"])
def test_torques_are_read_and_kept(paper: Rig, tmp_path: Path, header: str) -> None:
    run = import_csv(table(tmp_path, header, TAU), paper, out=tmp_path / "a.mcap")
    assert run.torques == pytest.approx(TAU, abs=1e-12)
    assert any("driven by" in note for note in run.notes)
    assert run.swing.between(0.2, 0.5).torques == pytest.approx(TAU[20:50])
    assert run.setup.torques is not None


def test_desired_and_measured_columns_of_named_joints_are_distinguished(paper: Rig, tmp_path: Path) -> None:
    """The log of a robot with a passive shoulder; its desired values have times of their own."""
    header = "shoulder_des_pos,elbow_des_pos,des_time,elbow_des_tau,shoulder_meas_pos,elbow_meas_pos,elbow_meas_tau"
    desired = [0 * T, 0.1 * T, T / 10, 2 * TAU[:, 1]]
    rows = np.column_stack([*desired, *ANGLES[:, 1:].T, TAU[:, 1], T])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=f"{header},meas_time", comments="")
    run = import_csv(tmp_path / "a.csv", paper)
    assert run.t[-1] == pytest.approx(T[-1])
    assert run.torques == pytest.approx(np.column_stack([0 * T, TAU[:, 1]]))
    assert run.torque_kind == "measured"


@pytest.mark.parametrize(("unit", "factor"), [("mNm", 1e-3), ("N mm", 1e-3), ("Ncm", 1e-2)])
def test_a_unit_in_the_name_of_a_torque_is_converted(paper: Rig, tmp_path: Path, unit: str, factor: float) -> None:
    run = import_csv(table(tmp_path, f"tau1_meas_{unit},tau2_meas_{unit}", TAU / factor), paper)
    assert run.torques == pytest.approx(TAU, abs=1e-12)


def test_columns_of_torques_can_be_named_and_scaled(paper: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "motor_a,motor_b", TAU)
    options, _ = parse_options("--columns tau1=motor_b,tau2=motor_a --scale tau2=-1")
    run = import_csv(file, paper, options)
    assert run.torques == pytest.approx(TAU[:, ::-1] * [1, -1])
    passive = import_csv(file, paper, ImportOptions(columns={"tau2": "motor_a"}))
    assert passive.torques == pytest.approx(TAU[:, :1] * [0, 1])
    with pytest.raises(RunError, match=r"no column is named 'motor_c' \(tau1\); the table has: t, theta1"):
        import_csv(file, paper, ImportOptions(columns={"tau1": "motor_c"}))


def test_rows_left_out_keep_the_impulse_of_their_torques(paper: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "tau1_Nm,tau2_Nm", TAU)
    lines = file.read_text().splitlines()
    for row in (31, 41, 42, 43):
        t, _, *rest = lines[row].split(",")
        lines[row] = ",".join([t, "nan", *rest])
    file.write_text("\n".join(lines) + "\n")
    run = import_csv(file, paper)
    assert run.torques is not None
    held = np.diff(run.t, append=T[-1] + 0.01)
    assert held @ run.torques == pytest.approx(0.01 * TAU.sum(axis=0))
    assert run.torques[29] == pytest.approx(TAU[29:31].mean(axis=0))
    assert run.torques[38] == pytest.approx(TAU[39:43].mean(axis=0))
    assert run.torques[50] == pytest.approx(TAU[54])


MEASURED, COMMANDED = ("tau1_measured_Nm", "tau2_measured_Nm"), ("tau1_commanded_Nm", "tau2_commanded_Nm")


@pytest.mark.parametrize("first", [MEASURED, ("tau1_Nm", "tau2_Nm"), ("tau_meas1", "tau_meas2")])
def test_measured_and_commanded_torques_are_shown(paper: Rig, tmp_path: Path, first: tuple[str, str]) -> None:
    file = table(tmp_path, ",".join(COMMANDED + first), 2 * TAU, TAU)
    shown = understand(file, paper, ImportOptions())
    assert shown.to_json()["torques"] == [
        {"kind": "measured", "columns": list(first)},
        {"kind": "commanded", "columns": list(COMMANDED)},
    ]
    assert f"measured {' and '.join(first)}; commanded tau1_commanded_Nm" in shown.facts()["torques"]


def test_of_measured_and_commanded_torques_both_are_kept(paper: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, ",".join(COMMANDED + MEASURED), 2 * TAU, TAU)
    made = import_csv(file, paper, out=tmp_path / "a.mcap")
    export(load_run(tmp_path / "a.mcap"), tmp_path / "a.csv")
    for run in (made, load_run(tmp_path / "a.mcap"), import_csv(tmp_path / "a.csv", paper)):
        assert run.torque_kind == "measured"
        assert run.torques == pytest.approx(TAU)
        assert run.commanded == pytest.approx(2 * TAU)
        assert run.readings_sha256 == made.readings_sha256


def test_of_measured_and_commanded_torques_one_can_be_kept_alone(paper: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, ",".join(MEASURED + COMMANDED), TAU, 2 * TAU)
    commanded = import_csv(file, paper, ImportOptions(torque="commanded"))
    assert (commanded.torque_kind, commanded.commanded) == ("commanded", None)
    assert commanded.torques == pytest.approx(2 * TAU)
    free = import_csv(file, paper, ImportOptions(torque="none"))
    assert free.torques is None
    assert "torques" not in understand(file, paper, ImportOptions(torque="none")).facts()
    with pytest.raises(RunError, match="names of tau1_commanded_Nm and tau_cmd1 denote the same torque"):
        import_csv(table(tmp_path, "tau1_commanded_Nm,tau_cmd1,tau_cmd2", TAU, TAU[:, :1]), paper)


def test_a_run_file_keeps_which_torques_they_are_and_how_late_they_act(paper: Rig, tmp_path: Path) -> None:
    file = table(tmp_path, "tau1_measured_Nm,tau2_measured_Nm", TAU)
    made = import_csv(
        file, paper, ImportOptions(input_delay_s=0.013, intersample="continuous"), out=tmp_path / "a.mcap"
    )
    for run in (made, load_run(tmp_path / "a.mcap")):
        assert (run.torque_kind, run.input_delay_s, run.continuous) == ("measured", 0.013, True)
        held = replace(run, continuous=False).setup.torques
        assert held is not None
        assert held.kind == "measured"
        assert held.mean_before([0.512, 0.514])[1] == pytest.approx(TAU[[49, 50]].mean(axis=0) @ _PUSHED)
        assert run.setup.torques is not None
        assert len(run.setup.torques.t) > 7 * len(run.t)
    with pytest.raises(ValueError, match="must be -1 to 1, not 2"):
        ImportOptions(input_delay_s=2.0)


def test_measured_torques_are_used_unless_commanded_ones_are_requested(paper: Rig, tmp_path: Path) -> None:
    metadata = RunMetadata(paper, None, 100.0, extra={"torque_kind": "measured", "torque_unit_uNm": "100"})
    with RunWriter(tmp_path / "a.mcap", metadata) as writer:
        writer.samples(
            np.arange(len(T)),
            np.round(8192 + 900 * np.sin(5 * T)[:, None] * [0, 1, 2]).astype(int),
            np.stack([TAU, 2 * TAU]),
        )
        writer.finish(RunSummary(release_tick=0))
    events: list[RunRead] = []
    for kind, scale, count in ((None, 1, 1), ("measured", 1, 0), ("commanded", 2, 0)):
        (run,) = read_runs([tmp_path / "a.mcap"], paper, events.append, torque=kind)  # pyright: ignore[reportArgumentType]
        assert run.setup.torques is not None
        assert run.setup.torques.kind == run.torque_kind == (kind or "measured")
        assert run.torques == pytest.approx(scale * TAU)
        assert sum("uses the measured torques" in note for note in events[-1].notes) == count
    both = load_run(tmp_path / "a.mcap")
    assert both.between(0.2, 0.5).commanded == pytest.approx(2 * TAU[20:50])
    export(both, tmp_path / "a.h5")
    again = import_csv(tmp_path / "a.h5", paper, ImportOptions(torque="commanded"))
    assert again.torques == pytest.approx(2 * TAU)
    with pytest.raises(RunError, match="no commanded torques, only measured torques: remove the option --torque"):
        both.driven_by("measured").driven_by("commanded")


def test_a_prescribed_arm_is_kept_and_refused_where_it_is_not_known(paper: Rig, tmp_path: Path) -> None:
    file = tmp_path / "arm.csv"
    theta0 = 0.3 * np.sin(4 * T)
    table_of = np.column_stack([T, theta0, ANGLES[:, 1:]])
    np.savetxt(file, table_of, delimiter=",", header="t,theta0,theta1,theta2", comments="")
    armed = paper.model_copy(update={"rig": RigGeometry(name="paper", L0=0.3, L1=0.4)})
    options = ImportOptions(arm="prescribed")
    made = import_csv(file, armed, options, out=tmp_path / "a.mcap")
    for run in (made, load_run(tmp_path / "a.mcap")):
        assert run.setup.arm is not None
        assert run.setup.arm.omega[5:-5] == pytest.approx(1.2 * np.cos(4 * T)[5:-5], abs=2e-3)
    with pytest.raises(RunError, match=r"needs its length L0 in \[rig\]"):
        import_csv(file, paper.model_copy(update={"rig": RigGeometry(name="paper", L1=0.4)}), options)
    with pytest.raises(RunError, match=r"a prescribed arm needs its angle: name its column.* The table has: t, "):
        import_csv(table(tmp_path, "tau1,tau2", TAU), armed, ImportOptions(arm="prescribed", columns={"t": "t"}))
    empty = tmp_path / "empty.csv"
    np.savetxt(empty, table_of * (1, np.nan, 1, 1), delimiter=",", header="t,theta0,theta1,theta2", comments="")
    with pytest.raises(RunError, match="the column of theta0 is empty; the angle of a prescribed arm is required"):
        understand(empty, armed, options)
    with pytest.raises(RunError, match="the angle of a prescribed joint is required in every row: name the columns of"):
        arm_motion(T, np.where(np.arange(T.size) == 3, np.nan, theta0), "a.csv")
    with pytest.raises(RunError, match="4 readings of theta0 are too few: at least 5 are needed"):
        arm_motion(T[:4], theta0[:4], "a.csv")


_PUSHED = np.array([[1.0, 0.0], [-1.0, 1.0]])
"""From torques of the joints to generalised ones."""


@pytest.mark.parametrize(("driven", "passive"), [(1, 2), (2, 1)])
def test_a_joint_without_a_torque_column_is_passive(paper: Rig, tmp_path: Path, driven: int, passive: int) -> None:
    expected = np.zeros_like(TAU)
    expected[:, driven - 1] = TAU[:, 0]
    for header, empty in ((f"tau{driven}_Nm", []), (f"tau{driven}_Nm,tau{passive}_Nm", [np.full(len(T), np.nan)])):
        file = table(tmp_path, header, TAU[:, 0], *empty)
        run = import_csv(file, paper)
        assert run.torques == pytest.approx(expected)
        assert f"joint {passive} has no torque column: treated as passive, with a torque of zero" in run.notes
        assert understand(file, paper, ImportOptions()).facts()["torques"].startswith(f"tau{driven}_Nm; up to")


def test_torques_of_the_other_kind_alone_are_refused(paper: Rig, tmp_path: Path) -> None:
    refusal = r"joint 2 has a torque \(tau_cmd2\), but no measured torque like tau_meas1.*--columns tau1=tau_meas1\)"
    with pytest.raises(RunError, match=refusal):
        import_csv(table(tmp_path, "tau_meas1,tau_cmd1,tau_cmd2", TAU, TAU[:, :1]), paper)
    with pytest.raises(RunError, match="has no column of measured torques"):
        import_csv(table(tmp_path, "other", TAU[:, :1]), paper, ImportOptions(torque="measured"))


def test_torques_of_another_length_are_refused(paper: Rig, tmp_path: Path) -> None:
    file = tmp_path / "driven.npz"
    np.savez(file, t=T, theta1=ANGLES[:, 1], theta2=ANGLES[:, 2], tau1=TAU[:-3, 0], tau2=TAU[:-3, 1])
    with pytest.raises(RunError, match="torques of another length: 97 values of 'tau1' for 100 rows"):
        import_csv(file, paper)


def test_torques_of_zero_are_a_free_swing(paper: Rig, tmp_path: Path) -> None:
    run = import_csv(table(tmp_path, "tau1,tau2", 0 * TAU), paper)
    assert run.torques is None
    assert any("a free swing" in note for note in run.notes)


def test_a_writer_takes_torques_of_its_rows_only(paper: Rig, tmp_path: Path) -> None:
    from dpr_lab.storage.metadata import RunMetadata

    theta = np.zeros((len(T), 3))
    with RunWriter(tmp_path / "b.mcap", RunMetadata(paper, None, 100.0, "import", "table")) as writer:
        with pytest.raises(ValueError, match="2 finite torques"):
            writer.table(T, theta, None, [TAU[:-1]])
        writer.table(T, theta, None, [TAU])
    assert load_run(tmp_path / "b.mcap").torques == pytest.approx(TAU)
