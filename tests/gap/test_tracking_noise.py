"""Correlated errors of tracked angles: measured in the residual of the bare model, behind a smooth remainder."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings, TrackingNoise
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests.bench_rigs import Rod, one_rod, rod_swing, table
from tests.thinned import candidates, thinned

RATE_HZ, NOISE_RAD = 120.0, 4e-3


def tracked(folder: Path, correlation: float, offset: float = 0.0, step: float = 1e-7) -> tuple[Rig, list[Run]]:
    """Film a rod with a zero error three times, with first-order autoregressive errors and readings rounded to a step,
    rad."""
    rng = np.random.default_rng(40)
    rig, runs = one_rod(0.3, 0.1, 65536, rng), []
    t = np.arange(0, 5, 1 / RATE_HZ)
    for k, start in enumerate((0.9, 1.4, 1.1)):
        errors = rng.normal(0, NOISE_RAD, len(t))
        for i in range(1, len(t)):
            errors[i] = correlation * errors[i - 1] + np.sqrt(1 - correlation**2) * errors[i]
        q = rod_swing(Rod(50.0, 0.05, 0.0, 0.0), start, t) + offset + errors
        runs.append(table(folder, f"film{k}", rig, {"t_s": t, "theta1_rad": step * np.rint(q / step)}))
    return rig, runs


def measured(rig: Rig, runs: list[Run]) -> tuple[TrackingNoise | None, float]:
    """Correlated errors of the recordings, and the standard deviation of joint 1 without them, rad."""
    records = tuple(record(run, rig) for run in runs)
    recordings, _, _ = fit_bare_model(Recordings(records, rig), nominal_ratios(rig))
    return recordings.tracking, float(records[0].screened.noise[0])


@pytest.mark.slow
@pytest.mark.parametrize("offset", thinned([0.03, 0.0], 2))
def test_the_residual_shows_the_size_and_the_correlation_of_the_errors(tmp_path: Path, offset: float) -> None:
    noise, rough = measured(*tracked(tmp_path, 0.8, offset))
    assert noise is not None
    assert noise.correlation == pytest.approx(0.8, abs=0.1)
    assert rough < 0.5 * NOISE_RAD
    assert rough * noise.factor[0] == pytest.approx(NOISE_RAD, rel=0.3)


@pytest.mark.long
def test_white_noise_and_rounded_readings_are_left_as_they_are(tmp_path: Path) -> None:
    assert measured(*tracked(tmp_path, 0.0, 0.03))[0] is None
    assert measured(*tracked(tmp_path, 0.8, 0.03, step=2e-3))[0] is None


@pytest.mark.slow
def test_a_zero_error_or_its_equal_is_named_behind_the_errors_of_a_tracker(tmp_path: Path) -> None:
    rig, runs = tracked(tmp_path, 0.8, 0.03)
    likely = candidates("encoder", "base_", "com_", "coulomb", "detent", "spring")
    diagnosis = diagnose(runs[:2], rig, held_out=runs[2:], library=likely)
    assert diagnosis.verdict == "named"
    # the three are equal for one rod; the plausible sizes decide which is named first
    (effect,) = diagnosis.effects
    assert effect.name in ("encoder_offset_joint1", "base_tilt", "com_offset_link1")
    assert "or one of 2 effects indistinguishable from it" in diagnosis.sentence
    assert {finding.run for finding in diagnosis.sensor_findings if finding.name == "non_white_noise"} == {
        run.name for run in runs
    }
