"""Properties of known torques according to a fitted model: their noise, and their values between two rows."""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects import param_index
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.fitting.disturbance import likeliest_noise, most_noise
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS, far_from_noise
from dpr_lab.gap.screen.recordings import Recordings


@dataclass(frozen=True, slots=True)
class RowRules:
    """Rules for known torques that change between the rows of a file."""

    earlier: float = 1.0
    """Maximum time by which known torques act before their rows, as a share of the interval between rows.

    The share is one half for samples of a continuous signal. It is smaller if the drive updates its torque several
    times per row, and larger if the last update was long before the row.
    """
    slack: float = 0.1
    """Uncertainty of the share `earlier`. A torque that acts even earlier was logged too late."""


ROWS = RowRules()


def with_likeliest_noise(
    recordings: Recordings, problem: Problem, model: Hypothesis, less: float = 0.8
) -> Recordings | None:
    """Recordings with a smaller noise of their measured torques, if a fitted model makes it more likely; else None.

    Args:
        recordings: the runs
        problem: segments of the runs
        model: fit to these segments
        less: ratio of two estimates of the noise below which the smaller one is fitted too
    """
    before = np.minimum(most_noise(problem), recordings.torque_noise_Nm)
    if problem.disturbance is None or not before.any():
        return None
    noise = np.minimum(likeliest_noise(problem, model.fit), before)
    if not (noise < less * before).any():
        return None
    return replace(recordings, torque_noise_Nm=(float(noise[0]), float(noise[1])))


def with_other_noise(recordings: Recordings, problem: Problem, model: Hypothesis) -> Recordings | None:
    """Recordings with a smaller noise of their torques, or with exact torques, if a selected model requires it.

    None if nothing changes.
    """
    if problem.disturbance is not None and far_from_noise(model):
        return replace(recordings, exact_torques=True)
    return with_likeliest_noise(recordings, problem, model)


def earlier_share(recordings: Recordings, model: Hypothesis) -> float:
    """Time by which known torques act before their rows, as a share of the interval between rows; 0 if they are held.

    The value of a row is the torque at its instant. The time for which it acted before and after is not recorded. A
    negative delay of less than a row is therefore not a property of the drive.
    """
    if INPUT_DELAY.name not in model.effects or recordings.torques_earlier:
        return 0.0
    early = -float(model.fit.estimate.params[param_index(INPUT_DELAY.name, "delay_s")])
    intervals = [float(np.median(np.diff(r.setup.torques.t))) for r in recordings.records if r.setup.torques]
    share = early / max(intervals, default=np.inf)
    return min(share, ROWS.earlier) if 0.0 < share <= ROWS.earlier + ROWS.slack else 0.0


def no_worse(held: Hypothesis, earlier: Hypothesis) -> bool:
    """Whether torques that act before their rows fit as well as held torques with a delay, up to the noise."""
    return earlier.cost < held.cost + THRESHOLDS.chance * held.residuals.inflation
