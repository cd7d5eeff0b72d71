from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.gap.screen.implausible import repeated
from dpr_lab.gap.screen.record import _blocks
from dpr_lab.gap.screen.sensor_faults import _late, screen
from dpr_lab.identification.misread.balance import periods
from dpr_lab.rig import Rig, Rods, load_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.options import ImportOptions
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from tests.gap.test_instants import readings


@pytest.fixture(scope="module")
def clean(recorded) -> Run:
    return recorded({}, duration=4.0)[1]


def names(run: Run, rig: Rig) -> set[str]:
    return {finding.name for finding in screen(run, rig).findings}


def changed(run: Run, rig: Rig, theta: np.ndarray) -> Run:
    counts = np.rint(rig.positions(theta)).astype(np.int64)
    return replace(run, theta=rig.theta(counts), counts=counts)


def test_a_healthy_run_has_no_findings(clean: Run, paper: Rig):
    assert names(clean, paper) == set()


def test_a_block_without_a_valid_reading_is_left_out(clean: Run, paper: Rig):
    seen = screen(clean, paper)
    keep = np.zeros_like(seen.keep)
    keep[:200] = True
    t, mean, sigma = _blocks(replace(seen, keep=keep), 100.0, 0.5)
    assert t[-1] < seen.t[200]
    assert np.isfinite(mean).all()
    assert np.isfinite(sigma).all()


@pytest.mark.parametrize("joint", [0, 1])
def test_a_step_is_detected_with_its_place_and_size(clean: Run, paper: Rig, joint: int):
    theta, at = clean.theta.copy(), len(clean.t) // 2
    size = 20 * abs(paper.radians_per_count[1 + joint])
    theta[at:, 1 + joint :] += size
    screened = screen(changed(clean, paper, theta), paper)
    (result,) = [finding for finding in screened.findings if finding.axis == f"joint{joint + 1}"]
    assert result.name == "missed_counts"
    assert result.at_s == pytest.approx(clean.t[at], abs=0.002)
    assert float(result.evidence.split()[4]) == pytest.approx(20, abs=4)
    assert screened.breaks[0][1] == joint


def test_an_outlier_is_masked_and_not_taken_for_a_step(clean: Run, paper: Rig):
    theta, at = clean.theta.copy(), len(clean.t) // 2
    theta[at, 1:] += 0.02
    screened = screen(changed(clean, paper, theta), paper)
    assert {finding.name for finding in screened.findings} == {"outlier"}
    assert not screened.keep[np.argmin(np.abs(screened.t - clean.t[at])), 0]
    assert screened.breaks == ()


def test_repeated_samples_are_found(clean: Run, paper: Rig):
    theta = clean.theta.copy()
    fast = np.flatnonzero((np.abs(np.gradient(theta[:, 1], clean.t)) > 5) & (clean.t > 0.5))[50:-50:200]
    theta[fast] = theta[fast - 1]
    result = [f for f in screen(changed(clean, paper, theta), paper).findings if f.name == "repeated_sample"]
    assert {f.at_s for f in result if f.axis == "joint1"} >= set(clean.t[fast].tolist())


def test_two_equal_readings_at_a_turning_point_that_ends_the_record_are_no_fault():
    t = np.arange(600) * 0.01
    count = 2 * np.pi / 1200
    turning = np.flatnonzero(np.diff(np.sign(np.diff(np.cos(6 * t)))))
    for last in turning[turning > 300]:  # the record ends at a turning point
        angle = np.round(np.cos(6 * t[: last + 2]) / count) * count
        joints = np.column_stack([angle, angle])
        assert not repeated(t[: last + 2], joints, np.full(2, count / np.sqrt(12)), 0.0, 0.01)[-4:].any()


@pytest.mark.parametrize("phase", np.linspace(0.0, 0.4, 9))
def test_two_equal_readings_on_both_sides_of_a_turning_point_are_no_fault_of_a_single_rod(phase: float):
    t, count = np.arange(150) * 0.1, 2 * np.pi / 1000
    angle = np.round(0.6 * np.exp(-t / 40) * np.cos(4.2 * t + phase) / count) * count
    for second in (angle, np.zeros_like(angle)):  # the same rod, or a clamped elbow
        joints = np.column_stack([angle, second])
        assert not repeated(t, joints, np.full(2, count / np.sqrt(12)), 0.0, 0.1).any()
        joints[40:43, 0] = angle[40]
        fast = abs(angle[43] - angle[40]) > 0.3
        assert repeated(t, joints, np.full(2, count / np.sqrt(12)), 0.0, 0.1)[41:43, 0].all() or not fast


def test_a_rod_that_vibrates_stands_and_moves_on_but_one_that_is_not_read_again_catches_up():
    t, count = np.arange(0.0, 1.0, 0.005), 2 * np.pi / 2400
    speed = 260 * count
    smooth = speed * (t + 0.9 * np.sin(2 * np.pi * 25 * t) / (2 * np.pi * 25))
    readings = np.round(np.column_stack([smooth, smooth]) / count) * count
    assert (np.diff(readings[:, 0]) == 0).sum() > 30
    assert repeated(t, readings, np.full(2, count / np.sqrt(12)), 0.0, 0.005)[4:-4].sum() <= 2
    fast = np.round(np.column_stack([4 * speed * t, 4 * speed * t]) / count) * count
    fast[[50, 80, 81]] = fast[[49, 79, 79]]
    result = repeated(t, fast, np.full(2, count / np.sqrt(12)), 0.0, 0.005)
    assert np.flatnonzero(result[:, 0]).tolist() == [50, 80, 81]


def test_readings_after_a_repeated_one_are_late_until_one_catches_up():
    t, count = np.arange(0.0, 0.2, 0.001), 2 * np.pi / 16384
    noise, true = np.full(2, count / np.sqrt(12)), 9.0 * t + 0.02 * np.sin(30 * t)
    for late in (1, 2, 3):
        readings = true.copy()
        readings[50 : 51 + late] = true[49 : 50 + late]
        joints = np.round(np.column_stack([readings, true]) / count) * count
        result = repeated(t, joints, noise, 0.0, 0.001)
        assert np.argwhere(result).tolist() == [[row, 0] for row in range(50, 51 + late)]
    rested = np.append(true[:50], true[49:-1])  # never catches up: the rod stood for a moment
    assert not repeated(t, np.round(np.column_stack([rested, true]) / count) * count, noise, 0.0, 0.001).any()


def test_missing_samples_are_counted(clean: Run, paper: Rig, rng: np.random.Generator):
    keep = (rng.random(len(clean.t)) > 0.02) | (clean.t < 0)
    keep[-1] = True
    run = replace(clean, t=clean.t[keep], theta=clean.theta[keep], counts=clean.counts[keep])
    (result,) = screen(run, paper).findings
    assert result.name == "gap"
    assert result.evidence.startswith(f"{(~keep).sum()} of")
    assert result.count == (~keep[1:] & keep[:-1]).sum()


def test_jitter_is_measured(recorded, paper: Rig):
    run = recorded({}, duration=4.0, jitter_ms=0.2)[1]
    screened = screen(run, paper)
    assert "jitter" in {finding.name for finding in screened.findings}
    assert screened.jitter_s == pytest.approx(2e-4, rel=0.2)


STRETCH = {"stale_every": 5, "stale_from_s": 1.0, "stale_for_s": 1.5}
LOST = {"lost_from_s": 1.5, "lost_for_s": 0.3}


@pytest.mark.parametrize(
    ("fault", "names"),
    [
        ({"late_every": 26, "late_ms": 2.5}, {"periodic_delay"}),
        ({"stale_every": 8}, {"repeated_sample"}),
        (STRETCH, {"repeated_sample"}),
        (LOST, {"gap"}),
        ({"repeated_share": 0.05}, {"repeated_sample"}),
        ({"late_every": 5, "late_ms": 3.3, **LOST}, {"periodic_delay", "gap"}),
        ({"stale_every": 5, **LOST}, {"repeated_sample", "gap"}),
        ({"jitter_ms": 0.2, **LOST}, {"jitter", "gap"}),
        ({"repeated_share": 0.04, **STRETCH}, {"repeated_sample"}),
    ],
    ids=lambda value: "+".join(value) if isinstance(value, dict) else None,
)
def test_faults_of_a_logger_are_named_alone_and_together(recorded, paper: Rig, fault: dict, names: set):
    harmless = {"outlier", "repeated_sample"}  # of a few samples
    for run in recorded({}, duration=4.0, **fault):
        result = {finding.name for finding in screen(run, paper).findings}
        assert names <= result <= names | harmless


def test_late_readings_are_found_among_repeated_ones_that_hide_them():
    """Every 40th reading is 2.5 ms late; between 0.5 and 1.5 s every second one repeats the one before."""
    number = np.arange(3000)
    late, again = number % 40 == 1, (number % 2 == 0) & (number >= 500) & (number < 1500)
    read = np.round(readings(number * 1e-3 + 2.5e-3 * late, 3e-4) / 1e-3) * 1e-3
    read[again] = read[np.flatnonzero(again) - 1]
    run = SimpleNamespace(setup=SimpleNamespace(alone=False), rate_hz=1000.0, name="logged")
    masked, findings = _late(run, number * 1e-3, read)
    assert [finding.name for finding in findings] == ["repeated_sample", "periodic_delay"]
    assert findings[1].evidence.startswith("one reading in 40")
    assert float(findings[1].evidence.split()[6]) == pytest.approx(2.5, rel=0.02)
    assert (masked >= late).all()
    assert np.mean(masked[again]) > 0.95
    assert not masked[(number % 2 == 1) & ~late].any()


def test_a_stretch_of_repeated_frames_is_masked_where_it_is(recorded, paper: Rig):
    run = recorded({}, duration=4.0, **STRETCH)[1]
    screened = screen(run, paper)
    (result,) = [finding for finding in screened.findings if finding.axis is None]
    assert "between 1." in result.evidence
    assert "one reading in 5 repeats" in result.evidence
    masked = screened.t[~screened.keep.all(axis=1)]
    inside = (masked >= 1.0) & (masked < 2.5)
    assert 0.9 * 300 < inside.sum() <= 300
    assert (~inside).sum() < 30


def test_counts_that_stand_still_at_rest_are_no_noise_free_measurement(clean: Run, paper: Rig):
    coarse = paper.model_copy(update={"encoders": paper.encoders.model_copy(update={"counts_per_rev": (4096,) * 3})})
    theta = clean.theta.copy()
    theta[clean.t < 0] = theta[clean.t < 0].mean(axis=0)
    screened = screen(changed(clean, coarse, theta), coarse)
    assert {finding.name for finding in screened.findings} == {"undithered_quantisation"}
    assert screened.noise == pytest.approx(2 * np.pi / 4096 / np.sqrt(12) * np.ones(2))


def test_noise_that_differs_from_the_rig_file_is_reported(recorded, paper: Rig):
    run = recorded({}, duration=2.0, noise_counts=2.0)[0]
    result = {(finding.name, finding.axis) for finding in screen(run, paper).findings}
    assert result == {("noise_level", "joint1"), ("noise_level", "joint2")}


def test_filtered_noise_is_reported_as_not_white(clean: Run, paper: Rig, rng: np.random.Generator):
    noise = np.convolve(rng.normal(0, 5e-3, len(clean.t) + 10), np.hanning(11) / 5, mode="valid")
    theta = clean.theta + noise[:, None]
    assert "non_white_noise" in names(replace(clean, theta=theta, counts=None), paper)


def test_a_rod_that_is_balanced_within_a_count_is_not_filtered(paper: Rig, rng: np.random.Generator):
    count, t = 2 * np.pi / 2048, np.arange(4000) / 500
    upright = np.cumsum(rng.normal(0, 0.02 * count, len(t)))
    angle = np.where(t < 1, np.sin(8 * t), 0.5 * count + upright - 0.99 * np.round(upright / count) * count)
    theta = count * np.round(angle / count)[:, None] * np.ones(3)
    run = Run("balanced", t, theta, None, None, paper.name, "", 500.0, mounting="inner")
    screened = screen(run, paper.with_rods("inner"))
    assert "non_white_noise" not in {finding.name for finding in screened.findings}
    balanced = screened.t > 1.2
    assert np.mean(screened.shared[balanced, 0]) > 10
    assert (screened.shared[screened.t < 0.8, 0] == 1).all()
    assert screened.noise[0] == pytest.approx(count / np.sqrt(12))


@pytest.mark.parametrize(
    "faults",
    [
        {"jitter_ms": 0.2, "repeated_share": 0.01, "missing_share": 0.02},
        {"step_counts": 4, "noise_counts": (0.0, 0.0, 0.0), "repeated_share": 0.01, "missing_share": 0.02},
        {"noise_counts": (0.3, 1.4, 0.9), "jitter_ms": 0.2},
    ],
    ids=["uneven", "coarse", "noisy"],
)
def test_a_dirty_encoder_without_missed_counts_is_not_reported_to_miss_them(recorded, paper: Rig, faults: dict):
    result = {name for run in recorded({}, **faults) for name in names(run, paper)}
    assert result
    assert "missed_counts" not in result


def test_a_burst_of_impossible_readings_is_masked(clean: Run, paper: Rig, rng: np.random.Generator):
    theta, burst = clean.theta.copy(), slice(len(clean.t) // 2, len(clean.t) // 2 + 40)
    theta[burst, 1:] += rng.uniform(-100, 100, (40, 1))
    screened = screen(changed(clean, paper, theta), paper)
    assert "outlier" in {finding.name for finding in screened.findings}
    within = (screened.t >= clean.t[burst.start]) & (screened.t < clean.t[burst.stop])
    assert not screened.keep[within, 0].any()


@pytest.mark.parametrize(
    ("rate_hz", "planted", "detected"), [(40, 0, False), (84, 0, False), (100, 0, False), (100, 40, True)]
)
def test_a_swing_sampled_at_a_low_rate_contains_no_missed_counts(
    paper: Rig, rate_hz: int, planted: int, detected: bool
) -> None:
    swing = record(load_plant("paper", 11), paper, 5.0, rate_hz)[1].swing
    theta = swing.theta.copy()
    theta[swing.t >= 2.0, 2] += planted * 2 * np.pi / 16384
    findings = screen(replace(swing, theta=theta, counts=None), paper).findings
    assert any(finding.name == "missed_counts" for finding in findings) == detected


@pytest.mark.parametrize(("rows_in_period", "planted", "detected"), [(8, 0, False), (30, 0, False), (30, 60, True)])
def test_few_rows_of_a_rod_contain_no_missed_counts(
    tmp_path: Path, rows_in_period: int, planted: int, detected: bool
) -> None:
    rig = load_rig("paper").model_copy(update={"rods": Rods(mounted="inner")})
    t = np.arange(0.0, 8.0, periods(rig)[0] / rows_in_period)
    e1 = (2 * np.pi / periods(rig)[0]) ** 2
    swing = solve_ivp(lambda _, x: [x[1], -e1 * np.sin(x[0]) - 0.3 * x[1]], (0, 8), [2.5, 0], t_eval=t, rtol=1e-9)
    count = abs(rig.radians_per_count[1])
    angle = np.rint(swing.y[0] / count) * count
    angle[len(t) // 2 :] += planted * count
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, angle]), delimiter=",", header="t,theta1", comments="")
    findings = screen(import_csv(tmp_path / "a.csv", rig, ImportOptions(zero="hanging")), rig).findings
    assert any(finding.name == "missed_counts" for finding in findings) == detected
