"""Rows lost by a camera or logger: the other rows keep their times."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv

RIG = load_rig("paper")
FPS, N = 100.0, 240
T = np.arange(N) / FPS
THETA = simulate(base_parameters(RIG.nominal, RIG.L1, RIG.g), RIG.L1, RIG.g, [np.pi / 2, 0.4, 0, 0], T)[:, :2]
PIXELS = 400.0


def write(folder: Path, header: str, *columns: np.ndarray) -> Path:
    rows = (",".join("" if np.isnan(x) else f"{x:.10g}" for x in row) for row in zip(*columns, strict=True))
    (folder / "film.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return folder / "film.csv"


def tracked(theta: np.ndarray) -> list[np.ndarray]:
    """Pixel coordinates of elbow and tip, y downwards."""
    inner, outer = PIXELS * np.stack([-np.sin(theta), -np.cos(theta)], axis=2).swapaxes(0, 1)
    return [*(700 + inner).T, *(700 + inner + outer).T]


@pytest.mark.parametrize("every", [1, 3])
def test_frames_that_are_missing_in_their_column_are_gaps(tmp_path: Path, every: int) -> None:
    kept = np.delete(np.arange(N), [30, 31, 32, 90])
    file = write(tmp_path, "frame,theta1,theta2", 7 + every * kept.astype(float), *THETA[kept].T)
    with pytest.raises(RunError, match=r"'frame' counts the rows: give their rate \(--rate-hz\)"):
        import_csv(file, RIG)
    run = import_csv(file, RIG, ImportOptions(rate_hz=FPS))
    np.testing.assert_allclose(run.t, T[kept], atol=1e-9)
    assert any(note == "interruptions kept: 2, the longest 0.04 s" for note in run.notes)
    assert any("of the camera, give --rate-hz 33.3333" in note for note in run.notes) == (every == 3)


def test_frame_numbers_need_no_name(tmp_path: Path) -> None:
    """A table without names begins with the numbers of every fifth frame; times in ms are no such numbers."""
    kept = np.delete(np.arange(N), [30, 31, 32, 90])
    rows, options = np.c_[5 * kept, THETA[kept]], ImportOptions(rate_hz=FPS, columns={"theta1": "2", "theta2": "3"})
    run = import_csv(write(tmp_path, "0,1.5708,0.4", *rows[1:].T), RIG, options)
    np.testing.assert_allclose(run.t, T[kept], atol=1e-9)
    assert any("'1' increases in steps of 5; 100 Hz is taken as the rate of the rows" in note for note in run.notes)
    ms = np.rint(1e3 * np.arange(N) / 30.0)
    timed = import_csv(write(tmp_path, "0,1.5708,0.4", *np.c_[ms, THETA][1:].T), RIG, options)
    np.testing.assert_allclose(timed.t, T, atol=1e-9)


def test_steps_that_agree_with_the_rate_are_times(tmp_path: Path) -> None:
    file = write(tmp_path, "0,1.5708,0.4", *np.c_[1e3 * T, THETA][1:].T)
    angles = {"theta1": "2", "theta2": "3"}
    notes = import_csv(file, RIG, ImportOptions(rate_hz=FPS, columns=angles)).notes
    sentence = "in steps of 10, probably times in ms: replace --rate-hz by --columns t=1 --time-unit ms"
    assert [note for note in notes if "--rate-hz" in note] == [f"'1' increases {sentence}"]
    np.testing.assert_allclose(import_csv(file, RIG, ImportOptions(time_unit="ms", columns={"t": "1"} | angles)).t, T)


@pytest.mark.parametrize("header", ["x1,y1,x2,y2", "frame_index,x1,y1,x2,y2"])
def test_frames_that_repeat_others_leave_the_times_of_the_rest(tmp_path: Path, header: str) -> None:
    """A video of 100 frames per second from a camera of 67."""
    shown = np.arange(N) - (np.arange(N) % 3 == 2)
    pixels = tracked(THETA[shown] + np.random.default_rng(8).normal(0, 1e-5, THETA.shape))
    numbered = [np.arange(N, dtype=float)] if header.startswith("frame") else []
    run = import_csv(write(tmp_path, header, *numbered, *pixels), RIG, ImportOptions(rate_hz=FPS))
    assert 0.6 * N < len(run.t) < 0.75 * N
    assert np.ptp(run.t) == pytest.approx(np.ptp(T), abs=3 / FPS)
    fresh = np.round((run.t - run.t[0]) * FPS).astype(int) + round((N - 1) - (run.t[-1] - run.t[0]) * FPS)
    np.testing.assert_allclose(run.theta[:, 1] % (2 * np.pi), THETA[shown[fresh], 0] % (2 * np.pi), atol=0.05)


def test_points_that_are_lost_here_and_there_are_gaps(tmp_path: Path) -> None:
    theta = THETA.copy()
    lost = np.random.default_rng(9).random(N) < 0.3
    lost[0] = False
    theta[lost] = np.nan
    run = import_csv(write(tmp_path, "t,theta1,theta2", T, *theta.T), RIG)
    np.testing.assert_allclose(run.t, T[~lost], atol=1e-9)


@pytest.mark.parametrize(("gone", "option"), [((0, 60), "--start-s 0.6"), ((160, N), "--start-s 0 --duration-s 1.6")])
def test_a_table_that_is_empty_for_long_names_its_good_part(tmp_path: Path, gone: tuple[int, int], option: str) -> None:
    theta = THETA.copy()
    theta[slice(*gone)] = np.nan
    file = write(tmp_path, "t,theta1,theta2", 12 + T, *theta.T)
    with pytest.raises(RunError, match=rf"use its longest part with values \({option}\)"):
        import_csv(file, RIG)
    words = option.split()
    part = {name[2:].replace("-", "_"): float(value) for name, value in zip(words[::2], words[1::2], strict=True)}
    assert np.isfinite(import_csv(file, RIG, ImportOptions(**part)).theta).all()


@pytest.mark.slow
def test_a_film_in_slow_motion_is_questioned_about_its_frame_rate(tmp_path: Path) -> None:
    noisy = THETA + np.random.default_rng(10).normal(0, 0.01, THETA.shape)
    file = write(tmp_path, "frame,theta1,theta2", np.arange(float(N)), *noisy.T)
    asked = f"; much less with --rate-hz {FPS:g}: was this the frame rate of the camera?"
    assert any(note.endswith(asked) for note in import_csv(file, RIG, ImportOptions(rate_hz=FPS / 4)).notes)
    assert "--rate-hz" not in " ".join(import_csv(file, RIG, ImportOptions(rate_hz=FPS)).notes)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_only_one_message_states_the_rate_of_a_film_without_most_of_its_frames(tmp_path: Path, noise: float) -> None:
    """The rate is that of all frames, and the table contains every fourth."""
    angles = THETA + np.random.default_rng(10).normal(0, noise, THETA.shape)
    file = write(tmp_path, "frame,theta1,theta2", 4 * np.arange(float(N)), *angles.T)
    notes = import_csv(file, RIG, ImportOptions(rate_hz=4 * FPS)).notes
    assert [
        note.count(f"{FPS:g} Hz (--rate-hz)") + note.count("--rate-hz 100") for note in notes if "rate" in note
    ] == [1]


def test_rows_of_other_quantities_are_no_lost_readings(tmp_path: Path) -> None:
    """A table with a row for each message keeps the lost readings of the angles as gaps."""
    empty, angles = np.full(N, np.nan), THETA.copy()
    angles[40:43] = np.nan
    times = np.column_stack([T, T + 0.004]).ravel()
    cable = np.column_stack([empty, np.full(N, 0.42)]).ravel()
    columns = [np.column_stack([angle, empty]).ravel() for angle in angles.T]
    run = import_csv(write(tmp_path, "time,cable,theta1,theta2", times, cable, *columns), RIG)
    np.testing.assert_allclose(run.t, np.delete(T, [40, 41, 42]), atol=1e-9)
    assert f"rows that contain only other quantities than the angles, removed: {N}" in run.notes


def test_angles_that_share_no_row_are_refused_by_name(tmp_path: Path) -> None:
    empty = np.full(N, np.nan)
    columns = [np.column_stack(pair).ravel() for pair in ([T, T + 0.004], [THETA[:, 0], empty], [empty, THETA[:, 1]])]
    with pytest.raises(RunError, match="no row contains theta1 and theta2: the logger writes them in separate rows"):
        import_csv(write(tmp_path, "t,theta1,theta2", *columns), RIG)


def test_torques_that_share_no_row_with_the_angles_are_refused(tmp_path: Path) -> None:
    empty = np.full(N, np.nan)
    torques = [np.column_stack([empty, np.sin(T)]).ravel()] * 2
    columns = [np.column_stack(pair).ravel() for pair in ([T, T + 0.004], *([angle, empty] for angle in THETA.T))]
    with pytest.raises(RunError, match="or interpolate angles and torques to the same times"):
        import_csv(write(tmp_path, "t,theta1,theta2,tau1_Nm,tau2_Nm", *columns, *torques), RIG)
