"""Columns that are no angles, points in space, dates in time stamps, and signs of unknown drives."""

from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import cast
from unittest.mock import patch

import numpy as np
import pytest
from scipy.linalg import eigh

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.readers.coordinates import OTHER, in_plane
from dpr_lab.storage.readers.points import read_text
from dpr_lab.storage.tables.interpreted import InterpretedTable
from dpr_lab.storage.tables.questions.questions import refuse_push
from dpr_lab.storage.tables.understand import understand
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record

T = np.arange(200) / 50
SWING = 0.8 * np.cos(6 * T)


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


@pytest.mark.parametrize("name", ["tip x (m)", "x (m)", "tip_y_px"])
def test_one_coordinate_of_a_point_is_refused(tmp_path: Path, one: Rig, name: str) -> None:
    with pytest.raises(RunError, match="is the name of one coordinate of a point"):
        import_csv(table(tmp_path, f"t,{name}", T, SWING), one)


def test_a_column_without_a_name_does_not_hide_that_none_is_an_angle(tmp_path: Path, one: Rig) -> None:
    for head, ending in (("t,Light (%),", "of the rod"), ("t,omega,", "for example the integral of a rate")):
        with pytest.raises(RunError, match=f"None of them is an angle: .*{ending}$"):
            import_csv(table(tmp_path, head, T, SWING, 0 * T), one)


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


def test_an_outlier_does_not_hide_the_plane_of_the_swing() -> None:
    across, up, depth = 0.3 * np.sin(SWING), -0.3 * np.cos(SWING), 0.03 * np.sin(SWING + 0.2 * T)
    up[100] = 1.5
    assert in_plane([("ball", axis) for axis in "xyz"], [across, depth, up])[1] == "x and z"


def test_a_note_states_that_no_plane_of_the_swing_was_found() -> None:
    x, y, z = SWING, 0.5 * SWING, 0.1 * SWING
    columns, axes, note = in_plane([("ball", axis) for axis in "xyz"], [x, y, z])
    assert (columns, axes) == ([("ball", "x"), ("ball", "y"), OTHER], "")
    assert note == "no plane of the swing was found in x, y, z of ball: the coordinates x and y are used"
    assert in_plane([("ball", axis) for axis in "xy"], [x, y])[2] == ""


@pytest.mark.parametrize(("amplitude", "warned"), [(0.1, True), (0.3, False)])
def test_a_short_arc_does_not_determine_the_pivot(tmp_path: Path, one: Rig, amplitude: float, warned: bool) -> None:
    swing, errors = amplitude * SWING / 0.8, np.random.default_rng(0).normal(0.0, 0.0017, (2, len(T)))
    file = table(tmp_path, "t,x,y", T, 2 + np.sin(swing) + errors[0], 2 - np.cos(swing) + errors[1])
    notes = " ".join(read_text(file, ()).notes)
    assert ("the arc of point is too short for its centre" in notes) == warned


@pytest.mark.parametrize("take", [("origin",), ("point", "origin")])
def test_the_origin_can_only_be_the_pivot(tmp_path: Path, take: tuple[str, ...]) -> None:
    file = table(tmp_path, "t,x,y", T, 0.3 * np.sin(SWING), -0.3 * np.cos(SWING))
    with pytest.raises(RunError, match="can only be the pivot, followed by other points: --take origin,NAME"):
        read_text(file, take)
    with pytest.raises(RunError, match="its points: point; the pivot may also be origin"):
        read_text(file, ("bob",))


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


@pytest.mark.parametrize(("first", "date"), [("0001-01-01T00:00:01.5", ""), ("2025-07-01T12:00:00.0", "2025")])
def test_digits_below_a_microsecond_and_dates_outside_the_clock_keep_the_times(
    tmp_path: Path, one: Rig, first: str, date: str
) -> None:
    """A date of year 1 is the smallest one of C# plus the elapsed time."""
    rows = [f"{first[:-3]}{2 + k // 50}.{2 * (k % 50):02d}0000{k:03d},{SWING[k]:.6f}\n" for k in range(200)]
    (tmp_path / "a.csv").write_text("Timestamp,angle\n" + "".join(rows))
    run = import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging"))
    np.testing.assert_allclose(run.t, T + 1e-9 * np.arange(200), rtol=0.0, atol=1e-10)
    assert run.recorded_utc[:4] == date


def test_points_keep_the_date_of_their_stamps(tmp_path: Path, one: Rig) -> None:
    rows = [
        f"2025-07-01T12:00:0{t:.3f}Z,{0.1 + 0.3 * np.sin(angle):.6f},{0.2 - 0.3 * np.cos(angle):.6f}\n"
        for t, angle in zip(T, SWING, strict=True)
    ]
    (tmp_path / "a.csv").write_text("Timestamp,x,y\n" + "".join(rows))
    assert import_csv(tmp_path / "a.csv", one).recorded_utc == "2025-07-01T12:00:00+00:00"


def test_a_set_point_is_no_sign_of_a_drive_if_the_torques_are_known(tmp_path: Path, one: Rig) -> None:
    columns = [T, SWING, SWING + 0.1 * np.sin(T)]
    for torque, drive in ((np.sin(5 * T), ""), (0 * T, "column target is the set point of a controller")):
        file = table(tmp_path, "time,theta1,target,tau1", *columns, torque)
        with patch("dpr_lab.storage.tables.understand.questions", return_value=[]) as asked:
            import_csv(file, one, ImportOptions(zero="hanging"))
        assert asked.call_args.args[0].drive.startswith(drive)
        assert bool(asked.call_args.args[0].drive) == bool(drive)


def test_a_set_point_is_named_as_a_sign_of_a_drive(tmp_path: Path, one: Rig) -> None:
    file = table(tmp_path, "time,position,goal_position", T, 0.5 * T, 0.5 * T + 0.1 * np.sin(T))
    questions = understand(file, one, ImportOptions(zero="hanging")).questions
    assert any("column goal_position is the set point of a controller" in question.sentence for question in questions)


@pytest.mark.parametrize("name", ["pwm", "Motor PWM", "duty_cycle"])
def test_a_duty_cycle_that_varies_is_named_as_a_sign_of_a_drive(tmp_path: Path, one: Rig, name: str) -> None:
    for duty, drives in ((100 * np.sin(5 * T), True), (0 * T, False)):
        file = table(tmp_path, f"time,angle,{name}", T, SWING, duty)
        read = understand(file, one, ImportOptions(zero="hanging"))
        assert drives == any(f"column {name} is the duty cycle of a motor" in note for note in read.notes)
        assert not read.torques


def test_zeros_are_not_guessed_if_motors_may_drive_the_rods(tmp_path: Path, paper: Rig) -> None:
    swing = record(load_plant("paper", 5), paper, 2.0, 200)[0].swing
    rods = [swing.t, swing.theta[:, 1] + 0.6, swing.theta[:, 2] + 0.6]
    free = understand(table(tmp_path, "t,theta1,theta2", *rods), paper, ImportOptions())
    assert any("--offset" in question.mend for question in free.questions)
    driven = understand(
        table(tmp_path, "t,theta1,theta2,tau1,tau2", *rods, 0 * swing.t, 0 * swing.t), paper, ImportOptions()
    )
    assert not any("--offset" in question.mend for question in driven.questions)
    assert any("the columns of the torques contain only zeros" in question.sentence for question in driven.questions)


def test_a_release_of_two_rods_is_no_push_although_a_light_outer_rod_swings_far() -> None:
    """Uniform rods without friction; the outer rod has a tenth of the mass and half of the length."""
    mass = np.array([[1 / 3 + 0.1, 0.025], [0.025, 0.025 / 3]])
    squares, modes = eigh(np.diag([0.6, 0.025]) * 9.81, mass)
    t = np.arange(0.0, 30.0, 0.01)
    start = modes.T @ mass @ [0.05, -0.05]
    rods = np.pi + (start * np.cos(np.sqrt(squares) * np.maximum(t - 1.0, 0.0)[:, None])) @ modes.T
    part = SimpleNamespace(rest=0, start=100, stop=len(t))
    theta = np.column_stack([0 * t, rods])
    swung = SimpleNamespace(path="a", t=t, theta=theta, part=part, swing=slice(100, len(t)), free=True)
    assert np.ptp(rods) > 7 * 0.05
    refuse_push(cast("InterpretedTable", swung), 0.0, None, "")


@pytest.mark.parametrize("rest", [0.0, 0.036, 0.09])
def test_a_rod_that_is_lifted_from_its_rest_was_pushed(tmp_path: Path, one: Rig, rest: float) -> None:
    """Its zero is off, so that it does not hang at 0 in the table."""
    lifted = rest + np.pi * np.sin(np.clip(T - 2, 0, np.pi / 2)) ** 2
    with pytest.raises(RunError, match="the rods hang at rest until"):
        import_csv(table(tmp_path, "t,theta1", T, lifted), one, ImportOptions(zero="hanging"))
