from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.acquisition.gate import CHECKS, DeviceState, JudgedRun, QualityReport, fastest_possible, judge
from dpr_lab.acquisition.rest import pose_error, rest_motion
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record

RATE_HZ = 1000
WORD = DeviceState(real_time=True, no_clock_fit="", statuses=50, latched=0)


@pytest.fixture
def rig() -> Rig:
    return load_rig("paper")


@pytest.fixture
def good(rig: Rig) -> Run:
    """Create a recording: a second of rest at X1 with encoder noise, 4 s of smooth motion, a second of hanging."""
    t = np.arange(-RATE_HZ, 5 * RATE_HZ + 1) / RATE_HZ
    swing = np.clip(t, 0, 4)
    inner, outer = 0.2 * (1 - np.cos(2 * np.pi * swing)), (np.pi - 0.1) / 2 * (1 - np.cos(np.pi * swing / 4))
    theta = rig.poses["X1"].theta + np.stack([0 * t, inner, outer], axis=-1)
    noise = np.random.default_rng(1).normal(0, rig.encoders.noise_counts, theta.shape)
    return _run(rig, t, np.round(rig.positions(theta) + noise).astype(np.int64))


def _run(rig: Rig, t: np.ndarray, counts: np.ndarray) -> Run:
    clock = {"rate_ppm": -80.0, "rate_ppm_std": 20.0}
    return Run(
        "test",
        t,
        rig.theta(counts),
        counts,
        "X1",
        rig.name,
        rig.sha256,
        RATE_HZ,
        clock=clock,
        lost={"contradicted_position": 0},
    )


def judged(run: Run, rig: Rig, **options: Any) -> QualityReport:
    return judge(JudgedRun(run, rig, **options))


def _failed(verdict: QualityReport) -> list[str]:
    return [check.name for check in verdict.checks if not check.ok]


def test_good_run_passes_every_check(good: Run, rig: Rig) -> None:
    verdict = judged(good, rig, duration=5.0, hanging=(0.001, -0.002), device=WORD)
    assert len(verdict.checks) == len(CHECKS)
    assert verdict.ok
    assert verdict.sentence == "ok"


def test_whole_turns_do_not_count_as_pose_error(good: Run, rig: Rig) -> None:
    turned = good.counts + np.array([0, 3, -2]) * np.array(rig.encoders.counts_per_rev)
    assert judged(_run(rig, good.t, turned), rig).ok


@pytest.mark.parametrize(
    ("rate", "std", "ok"),
    [(50_000, 100, False), (1_000_485, 100, False), (-700, 10, False), (500, 20, True), (5_000, 3_000, True)],
)
def test_a_clock_error_beyond_any_crystal_degrades_the_run(
    good: Run, rig: Rig, rate: float, std: float, ok: bool
) -> None:
    verdict = judged(replace(good, clock={"rate_ppm": rate, "rate_ppm_std": std}), rig, duration=5.0)
    assert verdict.ok == ok
    assert ok or "the device's clock runs" in verdict.sentence


FIT = {"rate_ppm": -80.0, "rate_ppm_std": 20.0}
ARRIVAL = {"arrival_ppm": -200.0, "arrival_margin_ppm": 900.0}
FAST = {"arrival_ppm": 50_000.0, "arrival_margin_ppm": 4_000.0}


@pytest.mark.parametrize(
    ("clock", "word", "failed", "says"),
    [
        (FIT | ARRIVAL, WORD, [], "ok"),
        (FIT, WORD, [], "ok"),
        (
            FIT | FAST,
            WORD,
            ["clock", "clock_fit"],
            "the rate error of the device's clock is -0.01 % by PONG, but +5.00",
        ),
        (
            FAST,
            replace(WORD, no_clock_fit="frozen"),
            ["clock", "clock_fit"],
            "runs 5.0 % fast (4.6 to 5.4) relative to this",
        ),
        (
            ARRIVAL,
            replace(WORD, no_clock_fit="frozen"),
            ["clock_fit"],
            "could not be checked by PING and PONG (frozen)",
        ),
        (ARRIVAL, WORD, ["clock_fit"], "although it declares its time as simulated"),
        ({"rate_ppm": 0.0, "rate_ppm_std": 4e4} | ARRIVAL, WORD, ["clock_fit"], "has an uncertainty of 4 %"),
        ({}, replace(WORD, real_time=False), [], "ok"),
        (FIT, replace(WORD, latched=50), ["latch"], "50 of 50 STATUS messages reported that the latch holds"),
        (FIT, replace(WORD, latched=5), [], "ok"),
        (FIT, replace(WORD, latched=2, statuses=2), [], "ok"),
    ],
)
def test_what_the_device_reports_is_compared_with_what_arrives(
    good: Run, rig: Rig, clock: dict[str, float], word: DeviceState, failed: list[str], says: str
) -> None:
    verdict = judged(replace(good, clock=clock), rig, duration=5.0, device=word)
    assert _failed(verdict) == failed
    assert says in verdict.sentence


def _drift(run: Run, rig: Rig) -> Run:
    return _with_rest(run, rig, 0.03 * run.t[run.t < 0])


def _shake(run: Run, rig: Rig) -> Run:
    return _with_rest(run, rig, 0.002 * np.sin(50 * run.t[run.t < 0]))


def _with_rest(run: Run, rig: Rig, moved: np.ndarray) -> Run:
    counts = run.counts.copy()
    counts[run.t < 0, 1] += np.round(moved / rig.radians_per_count[1]).astype(np.int64)
    return _run(rig, run.t, counts)


def _wrong_pose(run: Run, rig: Rig) -> Run:
    return _run(rig, run.t, run.counts + np.array([0, 0, round(0.06 / rig.radians_per_count[2])]))


def _pushed(run: Run, rig: Rig) -> Run:
    counts = run.counts.copy()
    counts[:, 2] += np.round(0.4 * np.maximum(run.t, 0) / rig.radians_per_count[2]).astype(np.int64)
    return _run(rig, run.t, counts)


def _damaged(run: Run, rig: Rig) -> Run:
    return replace(run, lost={"crc": 5, "framing": 0, "tick_gap": 4, "device_overrun": 0})


def _contradicted(run: Run, rig: Rig) -> Run:
    return replace(run, lost={"contradicted_position": 1})


def _gapped(run: Run, rig: Rig) -> Run:
    keep = (run.t < 2.0) | (run.t > 2.012)
    return _run(rig, run.t[keep], run.counts[keep])


def _uneven(run: Run, rig: Rig) -> Run:
    return _run(rig, run.t + np.where(np.arange(len(run.t)) % 2, 0.0002, 0), run.counts)


def _fast(run: Run, rig: Rig) -> Run:
    return replace(run, clock={"rate_ppm": 900.0, "rate_ppm_std": 20.0})


def _jumping(run: Run, rig: Rig) -> Run:
    counts = run.counts.copy()
    counts[4000:, 1] += 256
    return _run(rig, run.t, counts)


def _stuck(run: Run, rig: Rig) -> Run:
    counts = run.counts.copy()
    counts[:, 2] = counts[0, 2]
    return _run(rig, run.t, counts)


def _slipped(run: Run, rig: Rig) -> Run:
    counts = run.counts.copy()
    for at in range(1500, 4500, 300):
        counts[at:, 1] += 8
    return _run(rig, run.t, counts)


def _short(run: Run, rig: Rig) -> Run:
    keep = run.t < 4.0
    return _run(rig, run.t[keep], run.counts[keep])


def _cut(run: Run, rig: Rig) -> Run:
    return replace(run, complete=False)


FAULTS = {
    "rest_speed": _drift,
    "rest_spread": _shake,
    "pose": _wrong_pose,
    "release_speed": _pushed,
    "lost": _damaged,
    "contradicted_position": _contradicted,
    "gap": _gapped,
    "jitter": _uneven,
    "clock": _fast,
    "jumps": _jumping,
    "moved": _stuck,
    "hanging_after": _slipped,
    "duration": _short,
    "complete": _cut,
}


SHOWN_TWICE = {name: ["hanging_after"] for name in ("pose", "release_speed", "jumps", "moved")}
"""Faults that shift the rest of the run or stop a counter. The final position then also differs from hanging."""


@pytest.mark.parametrize("name", FAULTS)
def test_each_check_fails_on_its_own_fault(name: str, good: Run, rig: Rig) -> None:
    verdict = judged(FAULTS[name](good, rig), rig, duration=5.0)
    assert _failed(verdict) == [name, *SHOWN_TWICE.get(name, [])]
    assert verdict.sentence.startswith(f"degraded: {verdict.reasons[0]}")
    assert verdict.to_json()["ok"] is False


def test_an_interruption_is_measured_in_missing_samples(good: Run, rig: Rig) -> None:
    keep = np.ones(len(good.t), dtype=bool)
    keep[3000:3003] = False
    broken = _run(rig, good.t[keep], good.counts[keep])
    (measured,) = (check.measured for check in judged(broken, rig).checks if check.name == "gap")
    assert measured == 3


def test_a_contradicted_position_makes_angles_wrong_and_loses_no_samples(good: Run, rig: Rig) -> None:
    verdict = judged(_contradicted(good, rig), rig)
    assert "complete counts contradict the samples (number 1, limit 0)" in verdict.sentence
    assert "lost" not in verdict.sentence


def test_every_check_has_a_fault_that_fails_it(good: Run, rig: Rig) -> None:
    of_the_device = {"clock_fit", "latch"}  # which test_what_the_device_reports_is_compared_with_what_arrives tries
    checks = judged(good, rig, duration=5.0, device=WORD).checks
    assert [check.name for check in checks if check.name not in of_the_device] == list(FAULTS)


def test_rods_that_hung_askew_before_they_were_raised_degrade_the_run(good: Run, rig: Rig) -> None:
    verdict = judged(good, rig, duration=5.0, hanging=(0.001, -0.03))
    assert _failed(verdict) == ["hanging_before"]
    assert "the outer rod deviated by 0.030 rad from the vertical" in verdict.sentence


def test_a_table_without_rest_is_checked_without_the_rest(good: Run, rig: Rig) -> None:
    verdict = judged(replace(good.swing, counts=None, pose=None, clock={}, lost={}), rig)
    assert [check.name for check in verdict.checks] == [
        "lost",
        "gap",
        "jitter",
        "jumps",
        "moved",
        "hanging_after",
        "complete",
    ]
    assert verdict.ok


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_a_nearly_empty_run_is_checked_without_an_exception(samples: int, good: Run, rig: Rig) -> None:
    run = _run(rig, good.t[1000 : 1000 + samples], good.counts[1000 : 1000 + samples])
    assert _failed(judged(run, rig, duration=5.0)) == ["duration"]


def test_rest_motion_finds_slope_and_spread() -> None:
    t = np.arange(1000) / 1000
    theta = np.zeros((1000, 3))
    theta[:, 2] = 0.05 * t
    theta[:, 1] = np.where(np.arange(1000) % 2, 1e-3, -1e-3)
    speed, spread = rest_motion(t, theta)
    assert speed == pytest.approx(0.05)
    assert spread == pytest.approx(1e-3, rel=1e-3)


def test_pose_error_is_signed_and_wraps(rig: Rig) -> None:
    asked = rig.poses["X3"]
    error = pose_error(asked.theta + np.array([0, -0.02, 2 * np.pi + 0.03]), asked)
    assert error == pytest.approx([-0.02, 0.03])


@pytest.mark.slow
def test_no_state_of_the_rig_is_faster_than_the_fastest_possible(rig: Rig) -> None:
    """Every state with the energy of both rods upright, by brute force over angle between rods and direction."""
    l1, l2, m1, m2, mb, _, _, J1, J2 = rig.nominal
    L1, g = rig.L1, rig.g
    energy = 2 * g * (m1 * l1 + (m2 + mb) * L1 + m2 * l2)
    between, direction = np.meshgrid(np.linspace(0, np.pi, 181), np.linspace(0, np.pi, 20_001))
    w1, w2 = np.cos(direction), np.sin(direction)
    kinetic = 0.5 * (J1 + m1 * l1**2 + (m2 + mb) * L1**2) * w1**2 + 0.5 * (J2 + m2 * l2**2) * w2**2
    kinetic += m2 * L1 * l2 * np.cos(between) * w1 * w2
    scale = np.sqrt(energy / kinetic)
    brute = np.array([np.abs(scale * w1).max(), np.abs(scale * w2).max()])
    assert fastest_possible(rig) == pytest.approx(brute, rel=1e-3)
    assert np.all(brute <= fastest_possible(rig) * (1 + 1e-12))


@pytest.mark.parametrize("push", [0.0, 1.0])
def test_a_fast_rod_at_a_low_rate_is_not_pushed(push: float) -> None:
    rig = load_rig("furuta")
    t = np.arange(-50, 101) / 50
    swing = solve_ivp(lambda _, x: [x[1], 111.0 * np.sin(x[0])], (0, 2), [2.0, push], t_eval=t[t >= 0], rtol=1e-9)
    theta = np.where(t < 0, 2.0, np.append(np.zeros(50), swing.y[0]))
    counts = np.rint(rig.positions(np.stack([0 * t, theta, theta], axis=1))).astype(np.int64)
    run = replace(_run(rig, t, counts), rate_hz=50.0)
    assert ("release_speed" in {check.name for check in judged(run, rig).checks if not check.ok}) == (push > 0)


@pytest.mark.parametrize("counts", [1024, 4096])
def test_coarse_counts_are_neither_a_push_nor_a_jump(counts: int) -> None:
    rig = load_rig("paper")
    coarse = rig.model_copy(update={"encoders": rig.encoders.model_copy(update={"counts_per_rev": (counts,) * 3})})
    for seed in range(3):
        for run in record(load_plant("paper", seed), coarse, duration=2.0):
            assert not {check.name for check in judged(run, coarse).checks if not check.ok} & {"release_speed", "jumps"}


def test_a_joint_without_a_rod_need_not_turn_and_must_not(good: Run, rig: Rig) -> None:
    alone = replace(good, mounting="inner")
    assert "joint 2 turned by" in judged(alone, rig, duration=5.0).sentence
    still = good.counts.copy()
    still[:, 2] = 0
    assert not judged(_run(rig, good.t, still), rig).ok
    assert judged(replace(_run(rig, good.t, still), mounting="inner", pose=None), rig).sentence == "ok"
