"""Corrections of the recordings that forward selection shows to be necessary; each needs a new search.

The function of a correction returns the corrected recordings as a `ScreenedRuns`, because the search fits the bare
model again. It returns None if the recordings need no correction.

noise of torques    smaller than estimated from the recorded torques, or zero
earlier torques     torques that act before their time stamps, which appears as a negative delay
rolling shutter     readings of a film, corrected for the delay between the lines of a picture
moving camera       noise of a film whose camera rotates slowly
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects import param_index
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.gap.bare_model import with_likeliest_noise
from dpr_lab.gap.films import likeliest_camera, likeliest_shutter, shutter_explains_more
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, refutes_torque_noise
from dpr_lab.gap.state import Fitted, ScreenedRuns
from dpr_lab.gap.which.search import SearchState


@dataclass(frozen=True, slots=True)
class RowRules:
    """Rules for known torques that change between the rows of a file."""

    earlier: float = 1.0
    """Maximum time by which known torques act before their time stamps, as a share of the interval between rows.

    The share is one half for samples of a continuous signal, smaller for several updates per row, and larger if the
    last update was long before the row.
    """
    slack: float = 0.1
    """Tolerance of the limit `earlier`. A torque that acts even earlier was logged too late."""


ROWS = RowRules()


@dataclass(frozen=True, slots=True)
class ForwardSelected:
    """State after forward selection; the result may show that the recordings need a correction."""

    fitted: Fitted
    search: SearchState


def corrected(state: ForwardSelected, search: Callable[[ScreenedRuns], ForwardSelected]) -> ForwardSelected:
    """Apply each necessary correction, and repeat the search.

    Args:
        state: result of the first search
        search: function that fits the bare model to recordings, and selects effects forward
    """
    for _ in range(2):  # the noise may be smaller at first, and then zero
        if not (changed := with_other_noise(state.fitted, state.search.current)):
            break
        state = search(changed)
    for correct, is_better in (
        (_with_earlier_torques, _no_worse),
        (_with_shutter, lambda before, after: shutter_explains_more(before.search.current, after.search.current)),
        (_with_camera, _camera_explains_more),
    ):
        if changed := correct(state.fitted, state.search.current):
            repeated = search(changed)
            state = repeated if is_better(state, repeated) else state
    return state


def with_other_noise(fitted: Fitted, model: Hypothesis) -> ScreenedRuns | None:
    """Return the state with a smaller or zero noise of the known torques, if the fitted models require it."""
    if refutes_torque_noise(fitted.problem, model):  # known torques count as exact
        return replace(fitted, recordings=replace(fitted.recordings, exact_torques=True))
    recordings = with_likeliest_noise(fitted.recordings, fitted.problem, model)
    return recordings and replace(fitted, recordings=recordings)


def _with_earlier_torques(fitted: Fitted, model: Hypothesis) -> ScreenedRuns | None:
    """Return the state with earlier torques if the fitted delay is negative and at most the interval between rows."""
    recordings = fitted.recordings
    if INPUT_DELAY.name not in model.effects or recordings.torques_earlier:
        return None
    early = -float(model.estimate.params[param_index(INPUT_DELAY.name, "delay_s")])
    intervals = [float(np.median(np.diff(r.setup.torques.t))) for r in recordings.records if r.setup.torques]
    share = early / max(intervals, default=np.inf)
    if not 0.0 < share <= ROWS.earlier + ROWS.slack:
        return None
    recordings, held_out = (
        runs.with_earlier_torques(min(share, ROWS.earlier)) for runs in (recordings, fitted.held_out)
    )
    return replace(fitted, recordings=recordings, held_out=held_out)


def _no_worse(before: ForwardSelected, after: ForwardSelected) -> bool:
    """Return whether torques that act before their time stamps fit about as well as a negative delay, or better."""
    held, earlier = before.search.current, after.search.current
    return earlier.cost < held.cost + held.chance


def _with_shutter(fitted: Fitted, model: Hypothesis) -> ScreenedRuns | None:
    """Return the state with the readings corrected for the shutter that explains the bare model's residual.

    The bare model is used, because effects of the selected set may imitate a part of the delay.
    """
    shutter = likeliest_shutter(fitted.recordings, fitted.problem, fitted.bare)
    return shutter and replace(fitted, recordings=fitted.recordings.with_shutter(shutter))


def _with_camera(fitted: Fitted, model: Hypothesis) -> ScreenedRuns | None:
    angle_rad = likeliest_camera(fitted.recordings, fitted.problem, model)
    recordings, held_out = (runs.with_camera(angle_rad) for runs in (fitted.recordings, fitted.held_out))
    return replace(fitted, recordings=recordings, held_out=held_out) if angle_rad else None


def _camera_explains_more(before: ForwardSelected, after: ForwardSelected) -> bool:
    """Return whether a moving camera makes the readings more likely than a fixed one.

    Likelihoods of different numbers of readings are not comparable.
    """
    if before.fitted.problem.evidence != after.fitted.problem.evidence:
        return False
    moving = after.search.current
    fixed_cost, moving_cost = (
        state.search.current.cost_at(moving.inflation) + moving.inflation * state.fitted.problem.log_variance
        for state in (before, after)
    )
    return fixed_cost - moving_cost > moving.chance
