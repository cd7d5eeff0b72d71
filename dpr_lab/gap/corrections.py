"""Corrections of the recordings that the result of forward selection implies; the search is repeated after each one.

    noise of torques    smaller than estimated from the recorded torques, or zero
    earlier torques     torques that act before their rows, which looks like a negative delay
    kicks and steps     disturbances that a larger cause hid in the residuals of the bare model
    rolling shutter     correction of the readings of a film, in two passes

The first pass for the rolling shutter uses the delay of the bare model, because an effect may imitate a part of the
delay. The second pass uses the delay of the selected set, which includes other causes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects import param_index, without_events
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.bare_model import with_likeliest_noise
from dpr_lab.gap.damage.disturbances import without_jumps
from dpr_lab.gap.damage.jumps import JUMP
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS, far_from_noise
from dpr_lab.gap.rolling_shutter import explains_more, likeliest_shutter
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.state import Drafted, ScreenedRuns


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


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of one property of the recordings that the result of a search shows to be wrong."""

    correct: Callable[[Drafted], Drafted | None]
    """Function that returns the state with corrected recordings; None if no correction is needed."""
    better: Callable[[Drafted, Drafted], bool]
    """Function of the previous and the corrected state: whether the search of the corrected recordings is used."""
    most: int = 1
    """Maximum number of times that the correction is applied."""


def corrected(drafted: Drafted, search: Callable[[ScreenedRuns], Drafted]) -> Drafted:
    """Apply each correction that the result of a search implies, and repeat the search with the corrected recordings.

    Args:
        drafted: result of the first search
        search: function that fits the bare model to recordings and selects effects
    """
    for correction in CORRECTIONS:
        for _ in range(correction.most):
            changed = correction.correct(drafted)
            if changed is None:
                break
            again = search(changed)
            drafted = again if correction.better(drafted, again) else drafted
    return drafted


def with_other_noise(state: Drafted, model: Hypothesis) -> Drafted | None:
    """State with a smaller noise of known torques, or with exact torques, if a model requires it; otherwise None."""
    if state.problem.disturbance is not None and far_from_noise(model):
        return replace(state, recordings=replace(state.recordings, exact_torques=True))
    recordings = with_likeliest_noise(state.recordings, state.problem, model)
    return recordings and replace(state, recordings=recordings)


def _earlier_torques(state: Drafted) -> Drafted | None:
    share = _earlier_share(state.recordings, state.search.current)
    if not share:
        return None
    recordings, held_out = (runs.with_earlier_torques(share) for runs in (state.recordings, state.held_out))
    return replace(state, recordings=recordings, held_out=held_out)


def _earlier_share(recordings: Recordings, model: Hypothesis) -> float:
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


def _no_worse(held: Hypothesis, earlier: Hypothesis) -> bool:
    """Whether torques that act before their rows fit as well as held torques with a delay, up to the noise."""
    return earlier.cost < held.cost + THRESHOLDS.chance * held.residuals.inflation


def _jumps(state: Drafted) -> Drafted | None:
    """State without kicks and steps of readings; None if there are none, or if their exclusion explains too little.

    Missed counts are in the model only if a reading shows them. The held-out runs remain as they were screened with the
    bare model: a model must not choose the readings that test it.
    """
    estimate = state.search.current.fit.estimate
    if not any(record.screened.breaks for record in state.recordings.records):
        estimate = estimate.changed(params=without_events(estimate.params))
    recordings = without_jumps(state.recordings, estimate)
    if recordings is state.recordings or not _explains_better(state, recordings):
        return None
    return replace(state, recordings=recordings)


def _explains_better(state: Drafted, recordings: Recordings) -> bool:
    """Whether chi2 decreases by more than the smaller number of readings explains.

    With effects that have internal states (hysteresis, backlash), the residual jumps if a segment begins at another
    instant.
    """
    model = state.search.current.fit
    problem, initial = recordings.cut(recordings.working_length)
    other = fit(problem, model.estimate.changed(initial=initial), (), iterations=20)
    level = max(1.0, model.chi2 / state.problem.evidence)
    return model.chi2 - other.chi2 > JUMP.gain + level * (state.problem.evidence - problem.evidence)


def _shutter(state: Drafted, model: Hypothesis) -> Drafted | None:
    shutter = likeliest_shutter(state.recordings, state.problem, model)
    return shutter and replace(state, recordings=state.recordings.with_shutter(shutter))


def _shutter_explains_more(before: Drafted, after: Drafted) -> bool:
    return before.recordings.shutter is not None or explains_more(before.search.current, after.search.current)


CORRECTIONS = (
    Correction(lambda state: with_other_noise(state, state.search.current), lambda before, after: True, most=2),
    Correction(_earlier_torques, lambda before, after: _no_worse(before.search.current, after.search.current)),
    Correction(_jumps, lambda before, after: True),
    Correction(lambda state: _shutter(state, state.bare), _shutter_explains_more),
    Correction(lambda state: _shutter(state, state.search.current), _shutter_explains_more),
)
