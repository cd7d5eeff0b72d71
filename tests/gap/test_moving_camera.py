"""Film of one rod from a camera that turns slowly: the error is noise, and no effect of the rig."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.films import likeliest_camera
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure

L, NOISE_RAD = 0.25, 3e-3


def filmed(folder: Path, turned_rad: float, drag: float = 0.0, seconds: float = 10.0) -> tuple[Rig, Run]:
    """A uniform rod at 30 frames per second; the picture turns by a slow sine with a standard deviation."""
    t, stiffness = np.arange(0, seconds, 1 / 30), 1.5 * 9.81 / L

    def slope(now: float, x: np.ndarray) -> list[float]:
        return [x[1], -stiffness * np.sin(x[0]) - 0.03 * x[1] - drag * x[1] * abs(x[1])]

    angle = solve_ivp(slope, (0, seconds), [1.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-10).y[0]
    angle += turned_rad * 2**0.5 * np.sin(2 * np.pi * 0.13 * t + 0.5)
    points = L * np.column_stack([np.sin(angle), -np.cos(angle)])
    points += L * NOISE_RAD * np.random.default_rng(3).normal(size=points.shape)
    file = folder / "film.csv"
    np.savetxt(file, np.column_stack([t, points]), delimiter=",", header="t,x1,y1", comments="", fmt="%.6f")
    rig = parse_rig(draft_rig(RigMeasures("film", L, None, Measure(0.05), None, mounted="inner")))
    return rig, import_csv(file, rig)


@pytest.mark.parametrize("turned_rad", [0.0, 0.02])
def test_the_rotation_is_estimated_from_the_residual(tmp_path: Path, turned_rad: float) -> None:
    rig, run = filmed(tmp_path, turned_rad)
    recordings, problem, bare = fit_bare_model(Recordings((record(run, rig),), rig), nominal_ratios(rig))
    angle_rad = likeliest_camera(recordings, problem, bare)
    assert angle_rad == pytest.approx(turned_rad, rel=0.5)
    turning = recordings.with_camera(angle_rad)
    names = [finding.name for finding in turning.records[0].screened.findings]
    assert ("moving_camera" in names) == (turned_rad > 0.0)


def test_recordings_of_encoders_get_no_noise_of_a_camera(tmp_path: Path) -> None:
    rig, run = filmed(tmp_path, 0.0, seconds=4.0)
    film = record(run, rig)
    encoder = replace(film, run=replace(run, rate_hz=1000.0, film_noise=None))
    for records, expected in (((film,), 0.02), ((encoder,), 0.0), ((film, encoder), 0.0)):
        turning = Recordings(records, rig).with_camera(0.02)
        assert turning.camera_rad == expected
        names = {finding.name for record in turning.records for finding in record.screened.findings}
        assert ("moving_camera" in names) == (expected > 0.0)


def test_chi2_is_that_of_the_covariance_with_a_turning_picture(tmp_path: Path) -> None:
    rig, run = filmed(tmp_path, 0.02, seconds=4.0)
    recordings = Recordings((record(run, rig),), rig).with_camera(0.02)
    problem, _ = recordings.cut(0.5)
    residual = np.random.default_rng(1).normal(0.0, 0.01, problem.measured.shape)
    expected, volume = [], 0.0
    for first, last in zip(problem.segments.offsets[:-1], problem.segments.offsets[1:], strict=True):
        t, std = problem.t[first:last], 1 / problem.weight[first:last, 0]
        line = np.column_stack([np.ones(len(t)), 2 * (t - (t[0] + t[-1]) / 2) / (t[-1] - t[0])])
        covariance = np.diag(std**2) + 0.02**2 * line @ line.T
        expected.append(residual[first:last, 0] @ np.linalg.solve(covariance, residual[first:last, 0]))
        volume += np.linalg.slogdet(covariance)[1] - 2 * np.log(std).sum()
    assert problem.chi2_by_segment(problem.measured - residual) == pytest.approx(expected)
    assert problem.log_variance == pytest.approx(volume)


def test_an_absent_rod_has_no_readings(tmp_path: Path) -> None:
    rig, run = filmed(tmp_path, 0.0, seconds=4.0)
    film = record(run, rig)
    assert film.readings == len(film.t)
    assert film.without(film.t[:1], np.array([[True, False]])).readings == len(film.t) - 1


@pytest.mark.slow
def test_drag_is_named_behind_a_moving_camera(tmp_path: Path) -> None:
    """Without the noise of the camera, the verdict is "unexplained"."""
    rig, run = filmed(tmp_path, 0.03, drag=0.1)
    diagnosis = diagnose(replace(run, name="film"), rig)
    assert [effect.name for effect in diagnosis.effects] == ["air_drag_both"]
    assert "moving_camera" in {finding.name for finding in diagnosis.sensor_findings}


def test_readings_on_the_counts_of_the_encoder_are_no_film(tmp_path: Path) -> None:
    rig, run = filmed(tmp_path, 0.02)
    count = 2 * np.pi / rig.encoders.counts_per_rev[1]
    table = replace(run, film_noise=None)
    counted = replace(table, theta=0.3 + count * np.round((run.theta - 0.3) / count))
    for readings, film in ((table, True), (counted, False)):
        turning = Recordings((record(readings, rig),), rig).with_camera(0.02)
        assert turning.camera_rad == (0.02 if film else 0.0)
