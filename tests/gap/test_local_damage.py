"""Kicks and steps of readings are detected at their instants, identified by kind, and excluded."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.damage.disturbances import shows
from dpr_lab.gap.damage.jumps import Jump, _Changes, outstanding
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.finding import SensorFinding
from dpr_lab.gap.screen.record import Record, record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests.background_rigs import record as recorded
from tests.background_rigs import rig_and_base
from tests.bench_rigs import Rod, one_rod, rod_swing, table
from tests.thinned import candidates

W2 = 36.0
DAMAGE = ("disturbance", "reading_step", "missed_counts")


def cleaned(rig: Rig, runs: list[Run]) -> tuple[Record, ...]:
    """The recordings after the bare model has been fitted."""
    return fit_bare_model(Recordings(tuple(record(run, rig) for run in runs), rig), nominal_ratios(rig))[0].records


def damage(one: Record) -> list[SensorFinding]:
    """The findings of local damage."""
    return [finding for finding in one.screened.findings if finding.name in DAMAGE]


def two_rods(seed: int = 3) -> tuple[Rig, list[Run]]:
    """Two swings of two rods as tables of angles, which contain no counts."""
    rng = np.random.default_rng(seed)
    rig, base = rig_and_base(rng)
    runs = [recorded(rig, base, [], rng, pose, 4.0, rate_hz=100.0) for pose in ("X1", "X2")]
    shaken = [run.theta + rng.normal(0, 2e-4, run.theta.shape) for run in runs]
    return rig, [replace(run, name=run.name, theta=theta, counts=None) for run, theta in zip(runs, shaken, strict=True)]


def shifted(run: Run, joint: int, size: float, since: float, until: float = np.inf) -> Run:
    """A run in which the reading of a joint (0, 1) is shifted for a while."""
    theta = run.theta.copy()
    inside = (run.t >= since) & (run.t < until)
    theta[inside, 1 + joint :] += size
    return replace(run, theta=theta)


@pytest.mark.slow
@pytest.mark.parametrize(("joint", "since", "kept"), [(0, 1.3, (1.3, 4.0)), (1, 2.72, (0.0, 2.72))])
def test_of_a_reading_that_steps_and_stays_the_longer_part_is_kept(joint, since, kept):
    rig, (first, second) = two_rods()
    one, other = cleaned(rig, [shifted(first, joint, 0.01, since), second])
    (finding,) = damage(one)
    assert (finding.name, finding.axis) == ("reading_step", f"joint{joint + 1}")
    assert finding.at_s == pytest.approx(since, abs=0.011)
    assert finding.step == pytest.approx(0.01, rel=0.1)
    assert kept[0] - 0.011 <= one.t[0]
    assert one.t[-1] <= kept[1]
    assert damage(other) == []


@pytest.mark.slow
def test_of_a_reading_that_returns_only_the_part_in_between_is_left_out():
    rig, (first, second) = two_rods()
    one, _ = cleaned(rig, [shifted(first, 0, -0.02, 1.5, 2.1), second])
    assert {finding.name for finding in damage(one)} == {"reading_step"}
    assert one.t[0] < 0.1
    assert not ((one.t > 1.51) & (one.t < 2.09)).any()
    assert ((one.t > 2.2) & (one.t < 3.9)).any()


@pytest.mark.slow
@pytest.mark.parametrize("length", [0.02, 0.1])
def test_a_kick_that_lasts_is_no_step_of_a_reading(tmp_path, length):
    rng = np.random.default_rng(1)
    t, rig = np.arange(0.0, 6.0, 0.005), one_rod(1.5 * 9.81 / W2, 0.1, 4096, rng)
    rod = Rod(W2, 0.05, 0.0, 0.0, torque=lambda now: 0.3 / length * (3.1 < now < 3.1 + length))
    angle = rod_swing(rod, 1.0, t) + rng.normal(0, 5e-4, len(t))
    (one,) = cleaned(rig, [table(tmp_path, "kicked", rig, {"t_s": t, "theta1_rad": angle})])
    (finding,) = damage(one)
    assert finding.name == "disturbance"
    assert finding.at_s == pytest.approx(3.1 + length / 2, abs=0.06)


def candidate(gain: float, at: float) -> Jump:
    """The best kick of a segment."""
    return Jump(gain, 0, at, None, (0.1, 0.1), (at - 0.25, at + 0.25))


@pytest.mark.parametrize("step", [0.0, 0.026])
def test_a_step_of_the_residuals_alone_is_no_step_of_a_reading(step):
    """A model that lacks a large cause leaves such steps, where the readings are smooth."""
    rig, (run, _) = two_rods()
    one = record(run, rig)
    shifted = one.joints + step * np.outer(one.t > 1.0, [0.0, 1.0])
    assert shows(replace(one, joints=shifted), Jump(1e4, 0, 1.0, 1, (0.026,), (0.5, 1.5))) == bool(step)


def test_only_a_gain_far_above_all_others_is_a_jump():
    usual = [candidate(100.0 + i, 1.0 + i) for i in range(12)]
    assert outstanding([*usual, candidate(250.0, 20.0)], 3.0) == []
    assert outstanding([*usual, candidate(400.0, 20.0), candidate(390.0, 20.1)], 3.0) == [candidate(400.0, 20.0)]
    assert outstanding([candidate(400.0, 1.0), candidate(1.0, 2.0)], 3.0) == []


@pytest.mark.slow
def test_behind_a_step_of_a_table_the_friction_is_named(tmp_path):
    rng = np.random.default_rng(5)
    t, rig = np.arange(0.0, 8.0, 0.01), one_rod(1.5 * 9.81 / W2, 0.1, 4096, rng)
    angle = rod_swing(Rod(W2, 0.02, 0.25, 0.0), 1.0, t) + rng.normal(0, 5e-4, len(t))
    run = table(tmp_path, "slipped", rig, {"t_s": t, "theta1_rad": angle + 0.03 * (t > 5.5)})
    diagnosis = diagnose(run, rig, library=candidates("coulomb", "encoder_offset", "air_drag", "missed_counts"))
    assert {finding.name for finding in diagnosis.sensor_findings} >= {"reading_step"}
    assert {effect.name for effect in diagnosis.effects if effect.probability > 0.5} == {"coulomb_joint1"}


@pytest.mark.parametrize("seed", range(8))
def test_a_kick_without_an_effect_on_the_readings_has_no_size(seed: int) -> None:
    """Its columns cancel except for rounding errors, which may have either sign."""
    rng = np.random.default_rng(seed)
    out, into = rng.normal(size=(1, 2, 4)), np.zeros((1, 4, 2))
    into[0, :, 0] = 1e10 * np.linalg.svd(out[0])[2][3]
    first, after = np.array([0]), np.array([1])
    changes = _Changes(rng.normal(size=(1, 2)), np.ones((1, 2)), np.zeros((1, 2, 1)), out, into, first, after)
    gain, impulses = changes.kicks()
    assert np.isfinite(gain).all()
    assert np.isfinite(impulses).all()
