"""Corrections of the recordings that forward selection implies, each followed by a new search.

noise of torques    smaller than estimated from the recorded torques, or zero
earlier torques     torques that act before their rows, which looks like a negative delay
rolling shutter     correction of the readings of a film
moving camera       noise of a film whose picture turns slowly

`CORRECTIONS` contains them in this order.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects import param_index
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.gap.bare_model import with_likeliest_noise
from dpr_lab.gap.films import explains_more, likeliest_camera, likeliest_shutter
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, refutes_torque_noise
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.state import Fitted, ScreenedRuns
from dpr_lab.gap.which.search import SearchState


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
class ForwardSelected:
    """State after forward selection; the result may show that the recordings need a correction."""

    fitted: Fitted
    search: SearchState


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of a property of the recordings that proves wrong in a search."""

    correct: Callable[[Fitted, Hypothesis], ScreenedRuns | None]
    """Function of the fitted recordings and the selected set: the corrected recordings; None if none are needed."""
    better: Callable[[ForwardSelected, ForwardSelected], bool] = lambda before, after: True
    """Function of the previous and the corrected state: whether the search of the corrected recordings is used."""
    most: int = 1
    """Maximum number of times that the correction is applied."""


def corrected(preliminary: ForwardSelected, search: Callable[[ScreenedRuns], ForwardSelected]) -> ForwardSelected:
    """Apply each correction that a search implies, and repeat the search.

    Args:
        preliminary: result of the first search
        search: function that fits the bare model to recordings and selects effects
    """
    for correction in CORRECTIONS:
        for _ in range(correction.most):
            changed = correction.correct(preliminary.fitted, preliminary.search.current)
            if changed is None:
                break
            again = search(changed)
            preliminary = again if correction.better(preliminary, again) else preliminary
    return preliminary


def with_other_noise(fitted: Fitted, model: Hypothesis) -> ScreenedRuns | None:
    """Return the state with less or no noise of known torques, if a model requires the change."""
    if refutes_torque_noise(fitted.problem, model):
        return replace(fitted, recordings=replace(fitted.recordings, exact_torques=True))
    recordings = with_likeliest_noise(fitted.recordings, fitted.problem, model)
    return recordings and replace(fitted, recordings=recordings)


def _earlier_torques(fitted: Fitted, model: Hypothesis) -> ScreenedRuns | None:
    share = _earlier_share(fitted.recordings, model)
    if not share:
        return None
    return _with_changed_recordings(fitted, lambda runs: runs.with_earlier_torques(share))


def _with_changed_recordings(fitted: Fitted, change: Callable[[Recordings], Recordings]) -> Fitted:
    return replace(fitted, recordings=change(fitted.recordings), held_out=change(fitted.held_out))


def _earlier_share(recordings: Recordings, model: Hypothesis) -> float:
    """Return how early known torques act, as a share of the interval between rows.

    The share is 0 if each torque is held constant until the next row.
    """
    if INPUT_DELAY.name not in model.effects or recordings.torques_earlier:
        return 0.0
    early = -float(model.estimate.params[param_index(INPUT_DELAY.name, "delay_s")])
    intervals = [float(np.median(np.diff(r.setup.torques.t))) for r in recordings.records if r.setup.torques]
    share = early / max(intervals, default=np.inf)
    return min(share, ROWS.earlier) if 0.0 < share <= ROWS.earlier + ROWS.slack else 0.0


def _no_worse(before: ForwardSelected, after: ForwardSelected) -> bool:
    """Return whether early torques fit as well as torques that are held and delayed.

    Early torques act before their rows. Differences within the noise are ignored.
    """
    held, earlier = before.search.current, after.search.current
    return earlier.cost < held.cost + held.chance


def _shutter(fitted: Fitted, model: Hypothesis) -> ScreenedRuns | None:
    """Return the recordings with the shutter that explains most of the bare model's residual.

    The result is None if no shutter explains enough. The selected set is not used, because one of its effects may
    imitate a part of the delay of the shutter.
    """
    shutter = likeliest_shutter(fitted.recordings, fitted.problem, fitted.bare)
    return shutter and replace(fitted, recordings=fitted.recordings.with_shutter(shutter))


def _camera(fitted: Fitted, model: Hypothesis) -> ScreenedRuns | None:
    angle_rad = likeliest_camera(fitted.recordings, fitted.problem, model)
    return _with_changed_recordings(fitted, lambda runs: runs.with_camera(angle_rad)) if angle_rad else None


def _camera_explains_more(before: ForwardSelected, after: ForwardSelected) -> bool:
    """Return whether a moving camera makes the readings more likely than a fixed one.

    The result is false if the two searches used different numbers of readings, because their likelihoods are then not
    comparable.
    """
    if before.fitted.problem.evidence != after.fitted.problem.evidence:
        return False
    moving = after.search.current
    fixed_cost, moving_cost = (
        state.search.current.cost_at(moving.inflation) + moving.inflation * state.fitted.problem.log_variance
        for state in (before, after)
    )
    return fixed_cost - moving_cost > moving.chance


CORRECTIONS = (
    Correction(with_other_noise, most=2),
    Correction(_earlier_torques, _no_worse),
    Correction(_shutter, lambda before, after: explains_more(before.search.current, after.search.current)),
    Correction(_camera, _camera_explains_more),
)
