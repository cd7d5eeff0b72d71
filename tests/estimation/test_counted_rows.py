"""Tables with a row for each count of an encoder."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.arrays import Array
from dpr_lab.estimation.counted_rows import edge_rows
from dpr_lab.estimation.noise import noise_floor
from dpr_lab.estimation.repeated_readings import new_readings
from dpr_lab.gap.screen.record import record
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure

COUNTS = 1000
STEP = 2 * np.pi / COUNTS
ZERO = 0.004
CLOCK_S = 2e-5


def rod() -> Rig:
    mass = Measure(0.1)
    return parse_rig(draft_rig(RigMeasures("rod", 0.3, 0.3, mass, mass, counts_per_rev=COUNTS))).with_rods("inner")


def angle(t: Array) -> Array:
    return ZERO + 0.7 * np.exp(-0.1 * t) * np.cos(7.0 * t)


def rows(t: Array, *angles: Array) -> Array:
    """Times and readings (k, 1 + m), one row whenever one of the encoders counts."""
    read = STEP * np.rint(np.column_stack(angles) / STEP)
    counted = np.flatnonzero(np.diff(read, axis=0).any(axis=1)) + 1
    return np.column_stack([t[counted], read[counted]])


def imported(table: Array, rig: Rig, folder: Path, unit: str = "rad") -> Run:
    names = ("t", "theta1" if unit == "rad" else "counts1", "theta2")[: table.shape[1]]
    values = table.copy()
    if unit == "counts":
        values[:, 1:] = np.rint(table[:, 1:] / STEP) + np.array(rig.encoders.zero_counts)[1 : table.shape[1]]
    np.savetxt(folder / "a.csv", values, "%.8f", ",", header=",".join(names), comments="")
    return import_csv(folder / "a.csv", rig, ImportOptions(zero="hanging", unit=unit))


@pytest.fixture
def swing() -> Array:
    t = np.arange(0.0, 5.0, CLOCK_S)
    return rows(t, angle(t))


@pytest.mark.parametrize("unit", ["rad", "counts"])
def test_the_angle_of_a_row_is_that_of_the_edge_in_both_directions(swing: Array, tmp_path: Path, unit: str):
    run = imported(swing, rod(), tmp_path, unit)
    at = run.t + swing[1, 0]
    error = run.theta[:, 1] - np.pi - angle(at)
    assert run.at_edges
    assert np.abs(error).max() < 6.0 * CLOCK_S
    as_read = swing[1:, 1] - angle(at)
    assert np.abs(as_read).max() > 0.49 * STEP
    assert any("count" in note for note in run.notes)


def test_edges_have_no_rounding_error_and_no_missing_rows(swing: Array, tmp_path: Path):
    rig = rod()
    run = imported(swing, rig, tmp_path)
    std = noise_floor(run, rig).std_joint
    assert std[0] < 0.01 * STEP
    assert std[1] > 0.1 * STEP  # of an encoder without a rod, which no fit reads
    screened = record(run, rig)
    assert screened.screened.findings == ()
    assert len(screened.breaks) == 0
    np.testing.assert_array_equal(screened.screened.t, run.t)


@pytest.mark.slow
def test_turning_points_of_a_fine_encoder_are_kept(tmp_path: Path):
    t = np.arange(0.0, 5.0, CLOCK_S)
    read = STEP / 8 * np.rint(angle(t) / STEP * 8)
    counted = np.flatnonzero(np.diff(read)) + 1
    rig = rod()
    thinned = record(imported(np.column_stack([t, read])[counted], rig, tmp_path), rig)
    assert len(thinned.t) < len(counted) / 2
    assert np.diff(thinned.t).max() < 0.03


def test_half_swings_of_a_fine_encoder_are_no_bursts_of_rows():
    t, step = np.arange(0.0, 5.0, CLOCK_S), 2 * np.pi / 2400
    read = step * np.rint((ZERO + 0.8 * np.exp(-0.01 * t) * np.cos(6.3 * t)) / step)
    counted = np.flatnonzero(np.diff(read)) + 1
    rows, note = new_readings(t[counted], [read[counted]])
    assert len(rows) == len(counted)
    assert not note


@pytest.mark.slow
def test_a_run_file_keeps_the_edges(swing: Array, tmp_path: Path):
    rig = rod()
    run = imported(swing, rig, tmp_path)
    import_csv(tmp_path / "a.csv", rig, ImportOptions(zero="hanging", unit="rad"), out=tmp_path / "a.mcap")
    stored = load_run(tmp_path / "a.mcap")
    assert stored.at_edges
    np.testing.assert_allclose(stored.theta, run.theta, atol=1e-9)


@pytest.mark.slow
def test_of_two_encoders_only_the_one_that_counts_is_at_an_edge(paper: Rig, tmp_path: Path):
    t = np.arange(0.0, 5.0, CLOCK_S)
    inner, outer = angle(t), 0.9 * np.sin(11.0 * t + 1.0)
    counted = rows(t, inner, outer)
    table = counted.copy()
    table[:, 2] += table[:, 1] * paper.encoders.joint_angles.relative2
    run, kept = imported(table, paper, tmp_path), edge_rows(counted[:, 1:])
    assert run.at_edges
    assert kept is not None
    at, second = counted[kept, 0], counted[kept, 2] != counted[kept - 1, 2]
    joints = paper.encoders.joint_angles.of_rods(run.theta[:, 1:] - np.pi)
    errors = joints - np.column_stack([np.interp(at, t, inner), np.interp(at, t, outer)])
    assert np.abs(errors[~second, 0]).max() < 12.0 * CLOCK_S
    assert np.abs(errors[second, 1]).max() < 12.0 * CLOCK_S
    moved = np.sign(np.gradient(angle(at)))
    assert abs(np.mean(errors[:, 0] * moved)) < 0.05 * STEP
    assert noise_floor(run, paper).std_joint.min() > 0.1 * STEP


def test_a_row_after_a_lost_one_is_left_out(swing: Array):
    lost = np.delete(swing, [200], axis=0)
    result = edge_rows(lost[:, 1:])
    assert result is not None
    assert set(range(1, len(lost))) - set(result.tolist()) == {200}


@pytest.mark.parametrize("period", [1e-3, 5.2e-3])
def test_rows_at_an_even_rate_are_not_at_edges(period: float):
    t = np.arange(0.0, 5.0, period)
    assert edge_rows(STEP * np.rint(angle(t) / STEP)[:, None]) is None


def test_the_residual_of_a_single_rod_at_edges_is_finite(swing: Array, tmp_path: Path):
    run, rig = imported(swing, rod(), tmp_path), rod()
    whitening = noise_floor(run, rig).whitening
    assert np.isfinite(whitening).all()
