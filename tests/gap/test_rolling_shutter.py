"""A rolling shutter reads each point at another instant. It is named and corrected, and further causes are found."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from dpr_lab.acceptance.free_run import free_run_errors
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.films import likeliest_shutter, shutter_explains_more
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.residuals import ResidualStatistics
from dpr_lab.gap.result.diagnosis import Diagnosis, load_diagnosis
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.shutter import Lines, RollingShutter
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from tests.bench_rigs import Rod, one_rod, rod_swing, table
from tests.thinned import candidates

Array = np.ndarray
T = np.arange(0, 4, 1 / 60)
FINE = np.arange(-0.1, 4.1, 1 / 960)
DELAY = 0.016
"""Delay per distance, s/m: 8 ms over half a metre."""


def points(theta: Array, lengths: tuple[float, ...]) -> list[Array]:
    """Ends (n, 2) of the rods from the pivot, y upwards, m; theta (n, rods) from hanging."""
    rods = [L * np.column_stack([np.sin(q), -np.cos(q)]) for L, q in zip(lengths, theta.T, strict=True)]
    return list(np.cumsum(rods, axis=0))


def filmed(theta: Callable[[Array], Array], lengths: tuple[float, ...], line: Callable[[Array], Array]) -> Array:
    """Angles (n, rods) from hanging in a picture in which the line of a point p is read later by line(p) s."""
    seen = []
    for k in range(len(lengths)):
        t = T
        for _ in range(5):
            t = T + line(points(theta(t), lengths)[k])
        seen.append(points(theta(t), lengths)[k])
    rods = np.diff(np.stack([np.zeros_like(seen[0]), *seen]), axis=0)
    return np.unwrap(np.arctan2(rods[:, :, 0], -rods[:, :, 1]), axis=1).T


def double_rig() -> Rig:
    return parse_rig(draft_rig(RigMeasures("film", 0.3, 0.2, Measure(0.1), Measure(0.1))))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lines", "line"),
    [("horizontal", lambda p: -DELAY * p[:, 1]), ("vertical", lambda p: DELAY * p[:, 0])],
)
def test_the_correction_inverts_a_rolling_shutter(tmp_path: Path, lines: Lines, line: Callable[[Array], Array]) -> None:
    def theta(t: Array) -> Array:
        return np.column_stack([1.2 * np.cos(5 * t), 0.9 * np.sin(7 * t) + 0.3])

    rig, read = double_rig(), filmed(theta, (0.3, 0.2), line)
    run = table(tmp_path, "film", rig, {"t_s": T, "theta1_rad": read[:, 0], "theta2_rad": read[:, 1]})
    recordings = Recordings((record(run, rig),), rig)
    corrected = recordings.with_shutter(RollingShutter(lines=lines, delay_s_per_m=DELAY)).records[0]
    expected = rig.encoders.joint_angles.of_rods(np.pi + theta(corrected.t))
    before, after = (np.abs(one.joints - expected)[5:-5].max() for one in (recordings.records[0], corrected))
    assert before > 0.02
    assert after < 1e-3
    assert [finding.name for finding in corrected.screened.findings] == ["rolling_shutter"]


def rods_on_film(folder: Path, delay: float) -> tuple[Rig, list[Run]]:
    """A rod with air drag, filmed twice."""
    rng, rod, runs = np.random.default_rng(41), Rod(40.0, 0.04, 0.0, 0.02), []
    rig = one_rod(0.35, 0.1, 65536, rng)
    for k, start in enumerate((1.5, 1.2)):
        swing = CubicSpline(FINE, rod_swing(rod, start, FINE))
        read = filmed(lambda t, swing=swing: swing(t)[:, None], (0.35,), lambda p: -delay * p[:, 1])[:, 0]
        noisy = read + rng.normal(0, 2e-3, len(T))
        runs.append(table(folder, f"film{k}", rig, {"t_s": T, "theta1_rad": noisy}))
    return rig, runs


@pytest.mark.slow
def test_drag_is_named_behind_a_rolling_shutter(tmp_path: Path) -> None:
    rig, runs = rods_on_film(tmp_path, DELAY)
    library = candidates("air_drag", "coulomb", "spring")
    diagnosis = diagnose(runs[:1], rig, held_out=runs[1:], library=library, max_effects=1)
    assert [effect.name for effect in diagnosis.effects] == ["air_drag_both"]
    result = [finding for finding in diagnosis.sensor_findings if finding.name == "rolling_shutter"]
    assert [finding.run for finding in result] == [run.name for run in runs]
    delay_ms = float(result[0].evidence.split("lines): ")[1].split(" ms")[0])
    assert delay_ms == pytest.approx(1e3 * DELAY * rig.L1, rel=0.15)
    again = load_diagnosis_of(diagnosis, tmp_path)
    tested = free_run_errors(runs, rig, again, 2.0)
    uncorrected = free_run_errors(runs, rig, again.model_copy(update={"shutter": None}), 2.0)
    assert all(tested[name] < 0.6 * error for name, error in uncorrected.items())


def load_diagnosis_of(diagnosis: Diagnosis, folder: Path) -> Diagnosis:
    """Diagnosis as another command reads it from its file."""
    file = folder / "diagnosis.json"
    file.write_text(json.dumps(diagnosis.to_json()), encoding="utf-8")
    return load_diagnosis(file)


@pytest.mark.slow
def test_a_picture_that_is_read_at_once_has_no_rolling_shutter(tmp_path: Path) -> None:
    rig, runs = rods_on_film(tmp_path, 0.0)
    records = tuple(record(run, rig) for run in runs)
    recordings, problem, bare = fit_bare_model(Recordings(records, rig), nominal_ratios(rig))
    assert likeliest_shutter(recordings, problem, bare) is None


def test_a_correction_after_which_other_readings_are_left_out_is_not_kept() -> None:
    def fitted(chi2: Array) -> Hypothesis:
        fit = SimpleNamespace(free=(), chi2=chi2.sum(), linear=SimpleNamespace(chi2_by_segment=chi2))
        residuals = ResidualStatistics(float(chi2.sum()), 50 * len(chi2), level=1.0, autocorrelation=0.0)
        return Hypothesis((), cast(Any, fit), residuals, float(chi2.sum()), {})

    before, after = np.full(6, 1000.0), np.full(6, 50.0)
    assert shutter_explains_more(fitted(before), fitted(after))
    assert not shutter_explains_more(fitted(before), fitted(after[:5]))


def test_readings_of_a_rod_that_outruns_the_lines_are_put_in_the_order_of_their_instants() -> None:
    rig, t = double_rig(), np.arange(0, 2, 1 / 25)
    constants = rig_constants(rig)
    theta = np.pi + np.column_stack([30 * t, 30 * t])
    shutter = RollingShutter(lines="horizontal", delay_s_per_m=1 / (0.5 * 25))
    corrected = shutter.corrected(t, rig.encoders.joint_angles.of_rods(theta), constants, alone=False)
    assert np.isfinite(corrected).all()
