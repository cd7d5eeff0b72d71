"""Columns that are no angles, points in space, dates in time stamps, and signs of unknown drives."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.preview import preview
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from tests.storage.test_rod_alone import ONE_ROD

T = np.arange(200) / 50
SWING = 0.8 * np.cos(6 * T)


@pytest.fixture
def one(tmp_path: Path) -> Rig:
    file = tmp_path / "one.toml"
    file.write_text(ONE_ROD)
    return load_rig(file)


def table(folder: Path, head: str, *columns: np.ndarray) -> Path:
    file = folder / "a.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.6f")
    return file


@pytest.mark.parametrize("name", ["Light Intensity (%)", "Distance (cm)", "Magnetic field [µT]"])
def test_a_quantity_with_another_unit_is_no_angle(tmp_path: Path, one: Rig, name: str) -> None:
    file = table(tmp_path, f"Time (s),{name}", T, SWING)
    with pytest.raises(RunError, match=r"--columns theta1=NAME\. None of them is an angle"):
        import_csv(file, one)
    run = import_csv(file, one, ImportOptions(zero="hanging", columns={"theta1": name}))
    np.testing.assert_allclose(run.theta[:, 1] - np.pi, SWING, atol=1e-6)


def test_an_acceleration_is_not_proposed_as_an_angle(tmp_path: Path, paper: Rig) -> None:
    with pytest.raises(RunError, match="theta1=NAME,theta2=NAME; both rods are needed"):
        import_csv(table(tmp_path, "stamp,phi,alpha1", T, SWING, -SWING), paper)


@pytest.mark.parametrize(
    ("head", "order"), [("x,y,z", (0, 2, 1)), ("x,y,z", (2, 1, 0)), ("ball_z,ball_x,ball_y", (0, 1, 2))]
)
def test_a_swing_that_was_tracked_in_space_is_read_in_its_plane(
    tmp_path: Path, one: Rig, head: str, order: tuple[int, ...]
) -> None:
    """The point also moves by a tenth across the plane of the swing."""
    across, up, depth = 0.3 * np.sin(SWING), -0.3 * np.cos(SWING), 0.03 * np.sin(SWING + 0.2 * T)
    columns = [(across, up, depth)[k] for k in order]
    run = import_csv(table(tmp_path, f"time,{head}", T, *columns), one)
    np.testing.assert_allclose(np.abs(run.theta[:, 1] - np.pi), np.abs(SWING), atol=2e-3)


def test_the_times_of_points_can_be_named(tmp_path: Path, one: Rig) -> None:
    file = table(tmp_path, "stamp,x,y", T + 5, 0.3 * np.sin(SWING), -0.3 * np.cos(SWING))
    with pytest.raises(RunError, match="no single column found for t; the table has: stamp, theta1"):
        import_csv(file, one)
    np.testing.assert_allclose(import_csv(file, one, ImportOptions(columns={"t": "stamp"})).t, T, atol=1e-9)


def test_the_origin_can_be_the_pivot_of_points(tmp_path: Path, one: Rig) -> None:
    """The circle of the points has another centre, as in the picture of a lens with distortion."""
    file = table(tmp_path, "t,x,y", T, 0.02 + 0.3 * np.sin(SWING), 0.02 - 0.3 * np.cos(SWING))
    np.testing.assert_allclose(import_csv(file, one).theta[:, 1] - np.pi, SWING, atol=1e-3)
    about_origin = import_csv(file, one, ImportOptions(take=("origin", "point"))).theta[:, 1] - np.pi
    expected = np.arctan2(0.02 + 0.3 * np.sin(SWING), 0.3 * np.cos(SWING) - 0.02)
    np.testing.assert_allclose(about_origin, expected, atol=1e-5)


@pytest.mark.parametrize("zone", ["", "+02:00"])
def test_stamps_with_a_date_give_the_date_of_the_recording(tmp_path: Path, one: Rig, zone: str) -> None:
    """The recording lasts over midnight."""
    first = datetime.fromisoformat(f"2025-07-01 23:59:58{zone}").timestamp()
    stamps = [datetime.fromtimestamp(first + t, datetime.fromisoformat(f"2025-07-01 00:00:00{zone}").tzinfo) for t in T]
    rows = [f"{stamp.isoformat(' ', 'milliseconds')},{angle:.6f}\n" for stamp, angle in zip(stamps, SWING, strict=True)]
    (tmp_path / "a.csv").write_text("Timestamp,angle\n" + "".join(rows))
    run = import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging"))
    np.testing.assert_allclose(run.t, T, atol=1e-6)
    assert datetime.fromisoformat(run.recorded_utc).timestamp() == first


def test_a_set_point_is_named_as_a_sign_of_a_drive(tmp_path: Path, one: Rig) -> None:
    file = table(tmp_path, "time,position,goal_position", T, 0.5 * T, 0.5 * T + 0.1 * np.sin(T))
    questions = preview(file, one, ImportOptions(zero="hanging")).questions
    assert any("column goal_position is the set point of a controller" in question.sentence for question in questions)


def test_zeros_are_not_guessed_if_motors_may_drive_the_rods(tmp_path: Path, paper: Rig) -> None:
    swing = record(load_plant("paper", 5), paper, 2.0, 200)[0].swing
    rods = [swing.t, swing.theta[:, 1] + 0.6, swing.theta[:, 2] + 0.6]
    free = preview(table(tmp_path, "t,theta1,theta2", *rods), paper, ImportOptions())
    assert any("--offset" in question.mend for question in free.questions)
    driven = preview(
        table(tmp_path, "t,theta1,theta2,tau1,tau2", *rods, 0 * swing.t, 0 * swing.t), paper, ImportOptions()
    )
    assert not any("--offset" in question.mend for question in driven.questions)
    assert any("the columns of the torques contain only zeros" in question.sentence for question in driven.questions)


@pytest.mark.parametrize("rest", [0.0, 0.036, 0.09])
def test_a_rod_that_is_lifted_from_its_rest_was_pushed(tmp_path: Path, one: Rig, rest: float) -> None:
    """Its zero is off, so that it does not hang at 0 in the table."""
    lifted = rest + np.pi * np.sin(np.clip(T - 2, 0, np.pi / 2)) ** 2
    with pytest.raises(RunError, match="the rods hang at rest until"):
        import_csv(table(tmp_path, "t,theta1", T, lifted), one, ImportOptions(zero="hanging"))
