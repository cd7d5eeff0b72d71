"""Free run of a model from the first readings of a recording, even if there are few."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import SIZE
from dpr_lab.errors import RunError
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.screen.input import refuse_wrong_input
from dpr_lab.gap.screen.record import Record, record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.identification.moving_arm.identify import identify_moving_arm
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests.arm_engine import drawn_plant, recorded, rig_of

NOISE = 2e-4


def swing(rig: Rig, rate_hz: float, seed: int = 3) -> Record:
    t = np.arange(0.0, 4.0, 1 / rate_hz)
    base = base_parameters(rig.nominal, rig.L1, rig.g)
    theta = simulate(base, rig.L1, rig.g, [2.6, 2.9, 0, 0], t)[:, :2]
    theta = np.insert(theta + np.random.default_rng(seed).normal(0, NOISE, theta.shape), 0, 0.0, axis=1)
    return record(Run("x", t, theta, None, None, rig.name, "", rate_hz), rig)


def true_model(rig: Rig) -> Estimate:
    base = base_parameters(rig.nominal, rig.L1, rig.g)
    return Estimate.of(unknown_ratios(base), np.zeros(SIZE), np.zeros((0, 4)))


def error(rig: Rig, swing_record: Record) -> float:
    return free_runs(Recordings((swing_record,), rig), true_model(rig)).errors_rad["x"]


@pytest.mark.parametrize("rate_hz", [200.0, 20.0, 10.0])
def test_it_follows_however_few_readings_a_second_there_are(paper: Rig, rate_hz: float) -> None:
    assert error(paper, swing(paper, rate_hz)) < 20 * NOISE


def test_it_begins_after_breaks_that_come_too_soon(paper: Rig) -> None:
    result = swing(paper, 200.0)
    assert error(paper, replace(result, breaks=result.t[3:70:5] + 1e-3)) < 20 * NOISE


def test_a_recording_in_pieces_too_short_is_refused(paper: Rig) -> None:
    t = np.concatenate([k + np.arange(0, 0.02, 0.005) for k in range(8)])
    run = Run("x", t, np.full((len(t), 3), np.pi), None, None, paper.name, "", 200.0)
    with pytest.raises(RunError, match="x: no sequence of 8 valid samples without an interruption"):
        record(run, paper)


def arm_and_clamped_arm() -> tuple[Rig, list[Run]]:
    """Record a release with a free arm, and one with a clamped arm, as a plan proposes for a rig with an arm."""
    rng = np.random.default_rng(4)
    plant = drawn_plant(rng, False, "", 1.0, 0.12)
    rig, clamped = rig_of(plant, "free"), replace(plant, J0=1e6)
    (free, *_), (held, *_) = (recorded(one, rig, "free", rng, 1.0, 0.12) for one in (plant, clamped))
    return rig, [free, replace(held, name="held", arm_mode="clamped", theta=held.theta * [0.0, 1.0, 1.0])]


def test_runs_with_a_free_and_a_clamped_arm_are_simulated_together() -> None:
    rig, runs = arm_and_clamped_arm()
    recordings = Recordings(tuple(record(run, rig) for run in runs), rig)
    estimate = Estimate.of(nominal_ratios(rig), recordings.start_params, np.zeros((0, 4)))
    assert free_runs(recordings, estimate).errors_rad.keys() == {"run0", "held"}


def test_one_wrong_reading_of_a_clamped_arm_is_no_turn() -> None:
    rig, runs = arm_and_clamped_arm()
    theta = runs[1].theta.copy()
    theta[len(theta) // 2, 0] = 0.3
    recordings = Recordings(tuple(record(run, rig) for run in (runs[0], replace(runs[1], theta=theta))), rig)
    refuse_wrong_input(recordings, nominal_ratios(rig))


def test_a_clamped_arm_that_turns_is_refused_among_runs_with_a_free_arm() -> None:
    rig, runs = arm_and_clamped_arm()
    turned = replace(runs[1], theta=runs[1].theta + np.outer(runs[1].t, [0.5, 0.0, 0.0]))
    recordings = Recordings(tuple(record(run, rig) for run in (runs[0], turned)), rig)
    with pytest.raises(RunError, match=r"held: its arm is described as clamped, but encoder 0 turns by 0\.49 rad"):
        refuse_wrong_input(recordings, nominal_ratios(rig))
    with pytest.raises(RunError, match=r"held: its arm is described as clamped"):
        identify_moving_arm([runs[0], turned], rig)


@pytest.mark.slow
def test_the_expected_error_is_that_of_the_noise_of_the_first_readings(paper: Rig) -> None:
    _, _, model = fit_bare_model(Recordings((swing(paper, 100.0),), paper), nominal_ratios(paper))
    squares = []
    for seed in range(20):
        recordings = Recordings((swing(paper, 20.0, seed),), paper)
        runs = free_runs(recordings, true_model(paper), free=model.fit.free)
        expected = runs.expected_errors(1.0)["x"]
        squares.append([runs.errors["x"].rms_rad ** 2 - NOISE**2, expected.rms_rad**2])
    observed, predicted = np.mean(squares, axis=0)
    assert predicted > 0.5 * NOISE**2
    assert observed / predicted == pytest.approx(1.0, abs=0.4)
