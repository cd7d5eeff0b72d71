"""Detection of kicks and pushing hands at their instants, without false detections."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.damage.disturbances import _intervals, _merged, _remaining
from dpr_lab.gap.damage.jumps import Jump
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.screen.record import Record, record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests.background_rigs import recordings as background
from tests.bench_rigs import Rod, one_rod, rod_swing, table
from tests.thinned import candidates, thinned

W2 = 36.0
KICKS = [(3.4, -1.6), (6.25, 0.9)]
LOSSES = candidates("air_drag", "friction_drift", "coulomb", "stribeck", "encoder_offset")


def recorded(folder: Path, rod: Rod, seed: int = 0) -> tuple[Rig, list[Run]]:
    """Two releases of a rod, the first of them disturbed as `rod` says."""
    rng = np.random.default_rng(seed)
    t, rig = np.arange(0.0, 9.0, 0.01), one_rod(1.5 * 9.81 / W2, 0.1, 4096, rng)
    calm = Rod(W2, rod.viscous, rod.dry, rod.drag)
    runs = []
    for name, one, start in (("first", rod, 1.2), ("second", calm, 0.9)):
        angle = rod_swing(one, start, t) + rng.normal(0.0, 3e-4, len(t))
        count = 2 * np.pi / 4096
        runs.append(table(folder, name, rig, {"t_s": t, "theta1_rad": count * np.rint(angle / count)}))
    return rig, runs


def fitted(rig: Rig, runs: list[Run]) -> tuple[Recordings, Hypothesis]:
    """Recordings without disturbances, and the bare model."""
    screened = Recordings(tuple(record(run, rig) for run in runs), rig)
    cleaned, _, bare = fit_bare_model(screened, nominal_ratios(rig))
    return cleaned, bare


def disturbances(rig: Rig, runs: list[Run]) -> list[tuple[str, float | None]]:
    """Run and instant of each that the bare model's fit leads to."""
    return instants(fitted(rig, runs)[0])


def instants(cleaned: Recordings) -> list[tuple[str, float | None]]:
    """Run and instant of each disturbance."""
    findings = [finding for one in cleaned.records for finding in one.screened.findings]
    return [(finding.run, finding.at_s) for finding in findings if finding.name == "disturbance"]


@pytest.mark.slow
def test_each_kick_is_found_within_a_few_samples(tmp_path):
    rig, runs = recorded(tmp_path, Rod(W2, 0.02, 0.1, 0.01, kicks=list(KICKS)))
    assert disturbances(rig, runs) == [("first", pytest.approx(at, abs=0.02)) for at, _ in KICKS]


@pytest.mark.slow
def test_a_kick_where_a_segment_begins_is_found_too(tmp_path):
    rig, runs = recorded(tmp_path, Rod(W2, 0.02, 0.1, 0.01, kicks=[(4.5, 1.5)]))
    assert disturbances(rig, runs) == [("first", pytest.approx(4.5, abs=0.02))]


@pytest.mark.slow
def test_a_kick_is_found_although_another_recording_is_short(tmp_path):
    rig, runs = recorded(tmp_path, Rod(W2, 0.02, 0.1, 0.01, kicks=[(4.5, 1.5)]))
    short = replace(runs[1], t=runs[1].t[:14], theta=runs[1].theta[:14])
    assert disturbances(rig, [runs[0], short]) == [("first", pytest.approx(4.5, abs=0.02))]


@pytest.mark.slow
@pytest.mark.parametrize(("since", "until"), [(3.2, 4.3), pytest.param(5.1, 5.6, marks=pytest.mark.long)])
def test_a_push_in_the_middle_is_left_out_from_its_first_to_its_last_reading(tmp_path, since, until):
    push = Rod(W2, 0.02, 0.1, 0.01, torque=lambda now: 4.0 * (since < now < until))
    rig, runs = recorded(tmp_path, push)
    cleaned, bare = fitted(rig, runs)
    (result,) = instants(cleaned)
    assert result == ("first", pytest.approx(since, abs=0.15))
    left = cleaned.records[0].t
    assert not ((left > since + 0.05) & (left < until - 0.05)).any()
    assert len(left) > len(runs[0].t) - (until - since + 0.3) / 0.01
    assert bare.residuals.noise_ratio < 2.0


@pytest.mark.slow
def test_a_hand_that_pushes_at_the_beginning_is_left_out(tmp_path):
    rig, runs = recorded(tmp_path, Rod(W2, 0.02, 0.1, 0.01, push=(0.3, -60.0)))
    (result,) = disturbances(rig, runs)
    assert result == ("first", pytest.approx(0.0, abs=0.04))


@pytest.mark.slow
def test_a_hand_that_still_brakes_at_the_beginning_is_left_out(tmp_path):
    rig, runs = recorded(tmp_path, Rod(W2, 0.02, 0.1, 0.01, push=(0.12, 15.0)))
    cleaned, _ = fitted(rig, runs)
    assert 0.05 < cleaned.records[0].t[0] < 0.2
    assert cleaned.records[1].t[0] < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("rows", [0, 4])
def test_rows_in_which_a_hand_still_holds_the_rod_are_left_out_at_a_low_rate(tmp_path, rows):
    rng, t = np.random.default_rng(5), np.arange(0.0, 8.0, 0.05)
    rig = one_rod(1.5 * 9.81 / W2, 0.1, 4096, rng)
    hand = 0.6 + np.array([0.0, -0.005, 0.004, 0.001])[:rows]
    angle = np.append(hand, rod_swing(Rod(W2, 0.2, 0.0, 0.0), 0.6, t[: len(t) - rows]))
    run = table(tmp_path, "hand", rig, {"t_s": t, "theta1_rad": 2.6e-3 * np.rint(angle / 2.6e-3)})
    cleaned, _ = fitted(rig, [run])
    begin = float(cleaned.records[0].t[0])
    assert begin == pytest.approx(0.05 * (rows or 1), abs=0.06)
    assert bool(instants(cleaned)) == (rows > 0)


@pytest.mark.slow
@pytest.mark.parametrize(("since", "until", "acceleration"), [(0.53, 0.58, 30.0), (0.63, 0.98, 7.0)])
def test_a_push_soon_after_the_release_is_left_out_to_its_end(tmp_path, since, until, acceleration):
    rng, t = np.random.default_rng(0), np.arange(0.0, 3.0, 0.005)
    rig = one_rod(1.5 * 9.81 / W2, 0.1, 4096, rng)
    rod = Rod(W2, 0.3, 0.0, 0.0, torque=lambda now: acceleration * (since < now < until))
    angle = rod_swing(rod, 0.33, t) + rng.normal(0.0, 5e-4, len(t))
    run = table(tmp_path, "pushed", rig, {"t_s": t, "theta1_rad": angle})
    cleaned, bare = fitted(rig, [run])
    assert until < cleaned.records[0].t[0] < until + 0.3
    assert bare.residuals.noise_ratio < 0.5


def filmed(folder: Path, rod: Rod) -> tuple[Rig, list[Run]]:
    """A rod in a video of 30 frames per second, whose points scatter by a hundredth of its length."""
    rng = np.random.default_rng(1)
    t, rig = np.arange(0.0, 14.0, 1 / 30), one_rod(1.5 * 9.81 / 14.6, 0.1, 65536, rng)
    angle = rod_swing(rod, 1.15, t) + rng.normal(0.0, 9e-3, len(t))
    return rig, [table(folder, "film", rig, {"t_s": t, "theta1_rad": angle})]


@pytest.mark.slow
def test_a_hand_is_found_in_a_film_too(tmp_path):
    rig, runs = filmed(tmp_path, Rod(14.6, 0.06, 0.0, 0.0, push=(0.25, 30.0)))
    cleaned, _ = fitted(rig, runs)
    assert 0.2 < cleaned.records[0].t[0] < 1.0


@pytest.mark.parametrize("rod", [Rod(14.6, 0.06, 0.0, 0.0), Rod(14.6, 0.0, 0.0, 0.1)])
def test_a_film_of_a_rod_that_is_let_go_is_kept_whole(tmp_path, rod):
    rig, runs = filmed(tmp_path, rod)
    assert disturbances(rig, runs) == []


@pytest.mark.slow
def test_friction_and_drag_alone_disturb_nothing(tmp_path):
    rig, runs = recorded(tmp_path, Rod(W2, 0.05, 0.4, 0.05))
    assert disturbances(rig, runs) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", thinned(range(3), 3))
def test_effects_of_two_rods_are_no_disturbance(seed):
    rig, runs, _ = background(seed)
    assert disturbances(rig, runs) == []


@pytest.mark.slow
def test_kicks_of_a_held_out_run_are_listed(tmp_path):
    rig, (kicked, calm) = recorded(tmp_path, Rod(W2, 0.02, 0.1, 0.01, kicks=list(KICKS)))
    diagnosis = diagnose(calm, rig, held_out=kicked, library=LOSSES)
    listed = [(f.run, f.at_s) for f in diagnosis.sensor_findings if f.name == "disturbance"]
    assert listed == [("first", pytest.approx(at, abs=0.02)) for at, _ in KICKS]


@pytest.mark.long
def test_behind_kicks_the_dry_friction_is_named(tmp_path):
    rig, runs = recorded(tmp_path, Rod(W2, 0.02, 0.25, 0.0, kicks=list(KICKS)))
    diagnosis = diagnose(runs, rig, library=LOSSES)
    assert {finding.name for finding in diagnosis.sensor_findings} >= {"disturbance"}
    (dry,) = (effect for effect in diagnosis.effects if effect.name == "coulomb_joint1")
    assert dry.probability > 0.9


def swing(folder: Path, rate_hz: float, duration_s: float) -> Record:
    """A screened free swing in a table of angles."""
    t, rig = np.arange(0.0, duration_s, 1 / rate_hz), one_rod(1.5 * 9.81 / 14.6, 0.1, 65536, np.random.default_rng(0))
    angle = rod_swing(Rod(14.6, 0.06, 0.0, 0.0), 1.15, t) + np.random.default_rng(1).normal(0.0, 1e-3, len(t))
    return record(table(folder, "swing", rig, {"t_s": t, "theta1_rad": angle}), rig)


def jump(at: float, step: float | None = None) -> Jump:
    """A kick, or a step of the reading of joint 1."""
    return Jump(100.0, 0, at, None if step is None else 0, (1.0 if step is None else step,), (0.0, 9.0))


@pytest.mark.parametrize(
    ("kicks", "excluded"),
    [
        ([2.0, 4.0], [(1.95, 4.05)]),
        ([2.0, 4.45], [(1.95, 2.05), (4.4, 4.5)]),
        ([2.0, 4.0, 6.0], [(1.95, 4.05), (5.95, 6.05)]),
        ([0.3, 2.0], [(-np.inf, 0.35), (1.95, 2.05)]),
        ([0.2, 0.3], [(-np.inf, 0.35)]),
    ],
    ids=["push", "too long for a push", "three kicks", "release and later kick", "two kicks of the release"],
)
def test_only_two_kicks_after_the_release_exclude_the_readings_in_between(tmp_path, kicks, excluded):
    parts = _merged(_intervals(swing(tmp_path, 30.0, 9.0), [jump(at) for at in kicks]))
    assert [(part.since, part.until) for part in parts] == [pytest.approx(pair) for pair in excluded]


def test_the_only_segment_of_a_short_recording_is_kept_between_two_kicks(tmp_path):
    short = swing(tmp_path, 10.0, 3.2)
    parts = _intervals(short, [jump(0.67), jump(2.74)])
    (push,) = _merged(parts)
    outside = (short.t < push.since) | (short.t >= push.until)
    assert outside.sum() == 10  # six readings before the push and four after it, too few for a segment
    remaining = _remaining(short, parts)
    assert remaining is not None
    assert len(remaining.t) == len(short.t) - 2
    assert [finding.at_s for finding in remaining.screened.findings if finding.name == "disturbance"] == [0.67, 2.74]
    whole = _intervals(short, [jump(at) for at in np.arange(0.65, 3.2, 0.1)])
    assert _remaining(short, whole) is None


@pytest.mark.parametrize(
    ("jumps", "message"),
    [
        ([jump(4.0, 0.02), jump(5.0, -0.02), jump(5.1)], "returns at 5 s: the readings in between are excluded"),
        ([jump(6.9), jump(7.0, 0.02)], "stays: the tracker or the encoder slipped; the later readings are excluded"),
        ([jump(2.0, 0.02), jump(2.1)], "stays: the tracker or the encoder slipped; the earlier readings are excluded"),
    ],
)
def test_a_reading_returns_only_by_a_second_step(tmp_path, jumps, message):
    screened = swing(tmp_path, 30.0, 9.0)
    remaining = _remaining(screened, _intervals(screened, jumps))
    assert remaining is not None
    (finding,) = (finding for finding in remaining.screened.findings if finding.name == "reading_step")
    assert finding.evidence == f"the reading steps by +20 mrad and {message}"
