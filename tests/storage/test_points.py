"""Points of a video tracker as a recording."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import noise_floor, rest_correlation
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.readers.circle import most_of_a_circle
from dpr_lab.storage.readers.exchanged import exchanged
from dpr_lab.storage.readers.points import read_text
from tests.storage.swing_files import GUESSED, RIG, THETA1, THETA2, N, T, is_the_swing, read, text

PIVOT, L1, L2 = np.array([310.0, 240.0]), 180.0, 120.0
RNG = np.random.default_rng(7)
ELBOW = PIVOT + L1 * np.column_stack([-np.sin(THETA1), np.cos(THETA1)])
TIP = ELBOW + L2 * np.column_stack([-np.sin(THETA2), np.cos(THETA2)])


def pixels(up: float = 1.0, noise: float = 0.0) -> list[np.ndarray]:
    seen = [np.broadcast_to(PIVOT, ELBOW.shape), ELBOW, TIP]
    return [(points + RNG.normal(0, noise, points.shape)) * (1, up) for points in seen]


def test_points_of_tracker(tmp_path: Path) -> None:
    _, elbow, tip = pixels()
    rows = np.column_stack([T, elbow, tip])
    head = "#multi:\n\tmass A\t\tmass B\t\t\nt\tx\ty\tx\ty\t\n"
    file = text(tmp_path / "a.txt", rows, "\t", head)
    run = read(file)
    assert is_the_swing(run, atol=1e-6)
    assert any("pivot = (centre of the circle of mass A), elbow = mass A, tip = mass B" in note for note in run.notes)
    with pytest.raises(RunError, match="upright is 0, in rad: remove --angles relative and --zero hanging"):
        read(file, angles="relative", zero="hanging")


def test_points_of_tracker_without_names_are_numbered(tmp_path: Path) -> None:
    _, elbow, tip = pixels()
    run = read(text(tmp_path / "a.txt", np.column_stack([T, elbow, tip]), "\t", "t\tx\ty\tx\ty\n"))
    assert is_the_swing(run, atol=1e-6)
    assert any("elbow = point 1, tip = point 2" in note for note in run.notes)


@pytest.mark.slow
def test_points_of_deeplabcut_and_their_noise(tmp_path: Path) -> None:
    points = pixels(up=-1.0, noise=0.5)
    certain = np.ones(N)
    certain[40:43] = 0.1
    points[1][40:43] += 300
    columns = [column for point in points for column in (*point.T, certain)]
    names = ["pivot", "elbow", "tip"]
    scorer = "scorer," + ",".join(["DLC_resnet50"] * 9)
    parts = "bodyparts," + ",".join(name for name in names for _ in range(3))
    head = f"{scorer}\n{parts}\ncoords," + ",".join(["x", "y", "likelihood"] * 3) + "\n"
    file = text(tmp_path / "a.csv", np.column_stack([np.arange(N), *columns]), head=head)
    with pytest.raises(RunError, match="for a table without time give --rate-hz"):
        read(file)
    run = read(file, rate_hz=200.0)
    kept = np.delete(np.arange(N), [40, 41, 42])
    np.testing.assert_allclose(run.theta[:, 1], THETA1[kept], atol=5 * 0.5 / L1)
    own = [note for note in run.notes if "joint2" not in note]
    noise = [float(note.split("noise ")[1].split()[0]) for note in own if "noise" in note]
    assert noise == pytest.approx([0.5 / L1, 0.5 * np.sqrt(2) / L2], rel=0.3)
    with pytest.raises(RunError, match=r"changes its length by .* these points are not its ends"):
        read(file, rate_hz=200.0, take=("pivot", "tip", "elbow"))


@pytest.mark.parametrize("alike", [0.0, 0.8])
def test_the_scatter_of_the_lengths_is_the_noise_of_the_run(tmp_path: Path, alike: float) -> None:
    shaken = np.random.default_rng(3).normal(0, 1, (N, 2))
    for before, after in pairwise(range(N)):
        shaken[after] = alike * shaken[before] + np.sqrt(1 - alike**2) * shaken[after]
    tip = PIVOT + L1 * np.column_stack([-np.sin(THETA1), np.cos(THETA1)]) + 0.5 * shaken
    rods = RIG.model_copy(update={"rods": RIG.rods.model_copy(update={"mounted": "inner"})})
    file = text(tmp_path / "a.csv", np.column_stack([T, tip * (1, -1)]), head="t,x,y\n")
    for run in (import_csv(file, rods), import_csv(file, rods, out=tmp_path / "a.mcap")):
        assert run.film_noise is not None
        assert run.film_noise.std == pytest.approx([0.5 / L1], rel=0.2)
        assert run.film_noise.correlation == pytest.approx(alike, abs=0.1)
        assert noise_floor(run, rods).std_joint[0] == pytest.approx(0.5 / L1, rel=0.2)
        assert rest_correlation(run, rods, 2) == pytest.approx(alike**2, abs=0.15)


@pytest.mark.slow
def test_a_tilted_camera_is_no_noise(tmp_path: Path) -> None:
    _, elbow, tip = pixels(noise=0.5)
    seen = [PIVOT + (points - PIVOT) * (1, np.cos(0.15)) for points in (elbow, tip)]
    seen = [PIVOT + (p - PIVOT) / (1 + 1e-4 * (p - PIVOT)[:, 1:]) for p in seen]
    head = "t,x0,y0,x1,y1,x2,y2\n"
    run = read(text(tmp_path / "a.csv", np.column_stack([T, PIVOT + 0 * elbow, *seen]), head=head))
    assert run.film_noise is not None
    assert run.film_noise.std == pytest.approx([0.5 / L1, 0.5 * np.sqrt(2) / L2], rel=0.25)
    assert run.film_noise.correlation < 0.3
    assert any("the camera does not look along the joint axes" in note for note in run.notes)
    facing = read(text(tmp_path / "b.csv", np.column_stack([T, *pixels(noise=0.5)]), head=head))
    assert not any("camera" in note for note in facing.notes)


def test_frames_that_repeat_the_one_before_are_removed(tmp_path: Path) -> None:
    noise = np.random.default_rng(4).normal(0, 0.05, (2, N, 2))
    shown = np.arange(N) - (np.arange(N) % 3 == 2)  # every third frame repeats the second
    points = [(point[shown] + shaken) * (1, -1) for point, shaken in zip((ELBOW, TIP), noise, strict=True)]
    run = read(text(tmp_path / "a.csv", np.column_stack([T, *points]), head="t,x1,y1,x2,y2\n"))
    assert 0.62 * N < len(run.t) < 0.72 * N
    np.testing.assert_allclose(run.theta[:, 1], THETA1[np.searchsorted(T, run.t + 1e-9) - 1], atol=0.01)
    assert any("of the frames repeat the previous frame" in note for note in run.notes)


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_y_of_a_rod_whose_swing_decays_is_recognised(tmp_path: Path, up: float) -> None:
    t = np.arange(240) / 12
    angle = 0.8 * np.exp(-t / 6) * np.cos(4.7 * t)
    tip = 500 * np.column_stack([np.sin(angle), up * np.cos(angle)])
    rods = RIG.model_copy(update={"rods": RIG.rods.model_copy(update={"mounted": "inner"})})
    run = import_csv(text(tmp_path / "a.csv", np.column_stack([t, tip]), head="t,x,y\n"), rods)
    assert np.median(np.abs(run.theta[:, 1] - np.pi)) < 0.5


def test_columns_of_x_and_y_are_points_too(tmp_path: Path) -> None:
    rows = np.column_stack([T, *pixels(up=-1.0)])
    file = text(tmp_path / "a.csv", rows, head="t_s,x0_px,y0_px,x1_px,y1_px,x2_px,y2_px\n")
    assert is_the_swing(read(file), atol=1e-6)


def test_points_with_numbers_are_taken_in_their_order(tmp_path: Path) -> None:
    _, elbow, tip = pixels()
    run = read(text(tmp_path / "a.csv", np.column_stack([T, tip, elbow]), head="t,x_m2,y_m2,x_m1,y_m1\n"))
    assert "elbow = m1, tip = m2" in " ".join(run.notes)


@pytest.mark.parametrize(("timed", "pivoted"), [(True, False), (True, True), (False, False)])
def test_points_without_a_header_need_names(tmp_path: Path, timed: bool, pivoted: bool) -> None:
    rows = np.column_stack([*([T] if timed else []), *pixels()[not pivoted :]])
    file = text(tmp_path / "a.csv", rows)
    with pytest.raises(RunError, match="for points of a video add a first line with their names, for example t,x,y"):
        read(file, rate_hz=None if timed else 200.0)


def test_one_point_without_a_header_needs_names(tmp_path: Path) -> None:
    file = text(tmp_path / "bob.csv", np.column_stack([T, ELBOW]))
    with pytest.raises(RunError, match="for points of a video add a first line with their names, for example t,x,y"):
        import_csv(file, RIG.with_rods("inner"), ImportOptions(**GUESSED))


@pytest.mark.parametrize(
    "others", ["", "estimated x velocity for point mass 1,x velocity uncertainty for point mass 1,"]
)
def test_columns_that_name_coordinates_in_words_are_points_too(tmp_path: Path, others: str) -> None:
    rest = np.zeros((len(T), others.count(",")))
    rows = np.column_stack([T, rest, *(points - PIVOT for points in pixels()[1:]), 0 * T])
    named = [f"{axis} coordinate for point mass {k}" for k in (1, 2) for axis in "xy"]
    head = f"Time,{others}{','.join(named)},The hamiltonian (total energy) of the entire system\n"
    run = read(text(tmp_path / "a.csv", rows, head=head))
    assert is_the_swing(run, atol=1e-6)
    assert any("elbow = point mass 1, tip = point mass 2" in note for note in run.notes)


@pytest.mark.parametrize("up", [-1.0, 1.0])
def test_the_direction_of_y_is_found_for_rods_that_are_upright_most_of_the_time(tmp_path: Path, up: float) -> None:
    """A stretched double pendulum that turns over: theta'' = w^2 sin(theta), 0 = upright."""
    t = np.arange(0.0, 4.0, 0.01)
    theta = solve_ivp(lambda _, x: [x[1], 60.0 * np.sin(x[0])], (0.0, 4.0), [0.01, 0.05], t_eval=t, rtol=1e-9).y[0]
    assert np.median(np.cos(theta)) > 0
    along = np.column_stack([-np.sin(theta), np.cos(theta)]) * (1, up)
    file = text(tmp_path / "a.csv", np.column_stack([t, 0.3 * along, 0.5 * along]), head="t;x1;y1;x2;y2\n")
    file.write_text(file.read_text().replace(";", ","))
    table = read_text(file, ())
    np.testing.assert_allclose(table.column("theta1"), theta, atol=1e-6)


SWING = np.pi + 0.7 * np.cos(6 * T)
BOB = np.column_stack([-np.sin(SWING), np.cos(SWING)])


@pytest.mark.parametrize(
    ("points", "head", "pivot"),
    [
        (0.3 * BOB, "t,x,y\n", "the origin"),
        (0.3 * BOB * (1, -1), "t,x,y\n", "the origin"),
        (0.3 * BOB + (0.1, 0.25), "t (s),x (m),y (m)\n", "centre of the circle of point"),
        (PIVOT + 180.0 * BOB * (1, -1), "time_s,bob_x_px,bob_y_px\n", "centre of the circle of bob"),
        (
            np.column_stack([np.broadcast_to(PIVOT, BOB.shape), PIVOT + 180.0 * BOB * (1, -1)]),
            "t,x0,y0,x1,y1\n",
            "pivot = 0, tip = 1",
        ),
        (
            np.column_stack([0.3 * BOB + (0.1, 0.25), 0.3 * np.gradient(BOB, T, axis=0)]),
            ",".join(
                f"VideoAnalysis: {name}"
                for name in ("Time (s)", "X (m)", "Y (m)", "X Velocity (m/s)", "Y Velocity (m/s)")
            )
            + "\n",
            "centre of the circle of point",
        ),
    ],
)
def test_one_moving_point_is_a_single_rod(tmp_path: Path, points: np.ndarray, head: str, pivot: str) -> None:
    noisy = points + np.random.default_rng(3).normal(0, 1e-5 * np.ptp(points), points.shape)
    file = text(tmp_path / "bob.csv", np.column_stack([T, noisy]), head=head)
    run = import_csv(file, RIG.with_rods("inner"), ImportOptions(**GUESSED))
    np.testing.assert_allclose(run.theta[:, 1], SWING, atol=2e-3)
    assert any(pivot in note for note in run.notes)
    with pytest.raises(RunError, match="no single column found for theta2"):
        read(file)


def test_the_first_of_two_times_with_one_unit_is_used(tmp_path: Path) -> None:
    file = text(tmp_path / "bob.csv", np.column_stack([T, TIP - ELBOW, T + 5]), head="Time,x,y,t\n")
    run = import_csv(file, RIG.with_rods("inner"), ImportOptions(**GUESSED))
    assert "time: Time; t can also be the time (--columns t=NAME uses it)" in run.notes
    np.testing.assert_allclose(run.t, T, atol=1e-9)


@pytest.mark.parametrize(("head", "noted"), [("time [ms],t,x,y", True), ("frame,time [ms],x,y", False)])
def test_the_time_of_a_point_keeps_its_unit_and_another_time_is_noted(tmp_path: Path, head: str, noted: bool) -> None:
    other = T if noted else np.arange(N)
    times = (1000 * T, other) if noted else (other, 1000 * T)
    file = text(tmp_path / "bob.csv", np.column_stack([*times, TIP - ELBOW]), head=f"{head}\n")
    run = import_csv(file, RIG.with_rods("inner"), ImportOptions(**GUESSED))
    np.testing.assert_allclose(run.t, T, atol=1e-9)
    assert ("time: t; time [ms] can also be the time (--columns t=NAME uses it)" in run.notes) is noted


@pytest.mark.parametrize(("away", "noted"), [(0.006, True), (0.25, False)])
def test_an_origin_near_the_centre_of_the_circle_may_be_the_pivot(tmp_path: Path, away: float, noted: bool) -> None:
    points = 0.3 * BOB + (away, 0.0) + np.random.default_rng(4).normal(0, 1e-4, BOB.shape)
    table = read_text(text(tmp_path / "bob.csv", np.column_stack([T, points]), head="t,x,y\n"), ())
    note = "origin of the coordinates is 2 % of the rod's length from this centre"
    assert any(note in line and "--take origin,point" in line for line in table.notes) == noted


def test_the_pivot_is_found_although_the_tracker_followed_something_else_for_a_while(tmp_path: Path) -> None:
    points, rng = 0.3 * BOB + (0.1, 0.25), np.random.default_rng(8)
    points[: len(points) // 4] = 0.3 * BOB[: len(points) // 4] * (0.7, 0.5) + (0.13, 0.2)
    points[::17] += rng.normal(0, 0.1, points[::17].shape)
    file = text(tmp_path / "bob.csv", np.column_stack([T, points + rng.normal(0, 1e-5, points.shape)]), head="t,x,y\n")
    table = read_text(file, ())
    wrong = np.abs(np.hypot(*(points - (0.1, 0.25)).T) - 0.3) > 0.003
    np.testing.assert_array_equal(np.isnan(table.column("theta1")), wrong)
    right = np.arange(len(points)) % 17 > 0
    right[: len(points) // 4] = False
    np.testing.assert_allclose(table.column("theta1")[right], SWING[right], atol=2e-3)
    assert f"theta1: in {wrong.sum()} frames the length of the rod is wrong" in " ".join(table.notes)


def test_an_angle_that_was_never_computed_does_not_hide_the_points(tmp_path: Path) -> None:
    """A tracker program writes its column of the angle, the same value in all rows."""
    rows = np.column_stack([T, PIVOT + 180.0 * BOB * (1, -1), np.zeros(len(T))])
    file = text(tmp_path / "bob.csv", rows, head="time,x,y,theta\n")
    run = import_csv(file, RIG.with_rods("inner"), ImportOptions(**GUESSED))
    np.testing.assert_allclose(run.theta[:, 1], SWING, atol=2e-3)


def test_a_note_states_that_points_next_to_angles_are_not_used(tmp_path: Path) -> None:
    """An angle that a tracking program computed about the origin of the picture differs from the angle of the rod."""
    points = 180.0 * BOB + (3.0, 70.0)
    angle = np.degrees(np.arctan2(points[:, 0], -points[:, 1]))
    note = "the coordinates of points are not used, because the table also contains angles"
    for columns, names in (
        ((points,), "X,Y,"),
        ((), ""),
        ((0 * points,), "x,y,"),
        *(((points,), names) for names in ("accX,accY,", "vx,vy,", "fx,fy,", "gyro_x,gyro_y,", "cmd_x,cmd_y,")),
    ):
        rows = np.column_stack([T, *columns, angle])
        table = read_text(text(tmp_path / "a.csv", rows, head=f"t,{names}Angle(deg)\n"), ())
        assert any(note in words for words in table.notes) == (names == "X,Y,")


def test_a_column_that_is_named_as_the_angle_is_no_coordinate(tmp_path: Path) -> None:
    """A tracker exports the time as x and the angle as y."""
    file = text(tmp_path / "a.txt", np.column_stack([T, np.degrees(SWING) - 180]), "\t", "x\ty\n")
    columns = {"t": "x", "theta1": "y"}
    run = import_csv(file, RIG.with_rods("inner"), ImportOptions(unit="deg", zero="hanging", columns=columns))
    np.testing.assert_allclose(run.theta[:, 1], SWING, atol=1e-9)


@pytest.mark.parametrize("digits", [4, 7])
@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_frames_that_a_tracker_interpolated_are_removed(tmp_path: Path, noise: float, digits: int) -> None:
    """Tracker fills the frames in which it lost the point by a straight line; the rod seems to stop there."""
    t = np.arange(0.0, 6.0, 1 / 60)
    angle = 0.7 * np.exp(-0.05 * t) * np.cos(4.1 * t)
    rng = np.random.default_rng(5)
    point = 180.0 * np.column_stack([np.sin(angle), -np.cos(angle)]) + rng.normal(0.0, noise, (len(t), 2))
    lost = np.zeros(len(t), dtype=bool)
    for first, last in ((20, 24), (100, 118), (200, 202), (300, 320)):
        lost[first:last] = True
    for coordinate in point.T:
        coordinate[lost] = np.interp(t[lost], t[~lost], coordinate[~lost])
    file = text(tmp_path / "film.csv", np.column_stack([t, np.round(point, digits)]), head="t,x,y\n")
    table = read_text(file, ())
    np.testing.assert_allclose(table.values[0], t[~lost], atol=1e-5)
    assert any("of the frames are interpolated on a straight line in equal steps" in note for note in table.notes)


@pytest.mark.parametrize("pixel", [1.0, 0.1, 1e-6])
def test_frames_of_a_complete_film_are_not_called_interpolated(tmp_path: Path, pixel: float) -> None:
    t = np.arange(0.0, 20.0, 1 / 60)
    angle = 0.7 * np.exp(-0.05 * t) * np.cos(4.1 * t)
    rng = np.random.default_rng(6)
    point = 180.0 * np.column_stack([np.sin(angle), -np.cos(angle)]) + rng.normal(0.0, 0.3, (len(t), 2))
    table = read_text(
        text(tmp_path / "film.csv", np.column_stack([t, np.round(point / pixel) * pixel]), head="t,x,y\n"), ()
    )
    assert len(table.lines) == len(t)


@pytest.mark.parametrize("seed", range(4))
def test_pixels_that_were_scaled_and_rounded_are_not_called_interpolated(tmp_path: Path, seed: int) -> None:
    t = np.arange(0.0, 4.0, 1 / 60)
    angle = 0.7 * np.cos(4.1 * t)
    point = 440.0 * np.column_stack([np.sin(angle), -np.cos(angle)])
    point = 0.56 * np.round((point + np.random.default_rng(seed).normal(0, 1.6, point.shape)) / 0.56)
    point[len(t) // 2 :] += 0.13  # the axes were moved meanwhile
    file = text(tmp_path / "film.csv", np.column_stack([t, np.round(point, 1)]), head="t,x,y\n")
    assert len(read_text(file, ()).values[0]) == len(t)


def test_noise_does_not_make_the_circle_of_a_small_swing_smaller() -> None:
    """The radius of the algebraic fit alone is 22 % too small."""
    radii, times = [], np.arange(420) / 60
    swing = 0.04 + 0.2 * np.exp(-times / 20) * np.cos(5.5 * times)
    for seed in range(10):
        errors = np.random.default_rng(seed).normal(0.0, 0.003, (len(times), 2))
        points = np.column_stack([np.sin(swing), -np.cos(swing)]) + errors
        circle = most_of_a_circle(points)
        assert circle is not None
        radii.append(np.hypot(*(points - circle[0]).T).mean())
    assert np.mean(radii) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("named", [True, False])
def test_exchanged_marks_are_put_back(tmp_path: Path, named: bool) -> None:
    """A detector of two equal marks exchanges elbow and tip in whole parts of the film and in single frames."""
    pivot, elbow, tip = pixels(noise=0.3)
    correct = np.column_stack([T, pivot, elbow, tip] if named else [T, elbow, tip])
    mask = (np.arange(N) // (N // 5)) % 2 == 1
    mask[::17] ^= True
    first, second = np.where(mask[:, None], tip, elbow), np.where(mask[:, None], elbow, tip)
    mixed = np.column_stack([T, pivot, first, second] if named else [T, first, second])
    head = "t,x1,y1,x2,y2" + (",x3,y3\n" if named else "\n")
    expected, run = (
        read(text(tmp_path / name, rows, head=head)) for name, rows in (("a.csv", correct), ("b.csv", mixed))
    )
    np.testing.assert_array_equal(run.theta, expected.theta)
    says = f"exchanged in {mask.sum()} frames"
    assert any(says in note for note in run.notes)
    assert not any("exchanged" in note for note in expected.notes)


@pytest.mark.parametrize("pivot", [None, np.zeros(2)])
@pytest.mark.parametrize("tip_first", [True, False])
def test_in_a_small_swing_the_elbow_is_the_mark_near_the_pivot(pivot: np.ndarray | None, tip_first: bool) -> None:
    """Both marks move on circles; the tip is farther from the pivot. A tracker confused them from frame 180 on."""
    swing = 0.1 * np.sin(np.linspace(0, 20, 300))
    way = np.column_stack([np.sin(swing), np.cos(swing)])
    noise = np.random.default_rng(5).normal(0, 0.3, (2, 300, 2))
    elbow, tip = 180 * way + noise[0], 300 * way + noise[1]
    mask = (np.arange(300) > 180) ^ tip_first
    first, second = np.where(mask[:, None], tip, elbow), np.where(mask[:, None], elbow, tip)
    np.testing.assert_array_equal(exchanged(first, second, pivot), mask)
    assert not exchanged(elbow, tip, pivot).any()
