"""Corrections of the recordings that a set of effects implies; after each correction, the effects are searched again.

    noise of torques    smaller than at rest, or zero, if the set shows it
    earlier torques     torques that act before their rows, which looks like a negative delay
    kicks and steps     disturbances that a larger cause hid in the residuals of the bare model
    rolling shutter     correction of the readings of a film, in two passes

The first pass for the rolling shutter uses the delay of the bare model, because an effect may imitate a part of the
delay. The second pass uses the delay of the set, which includes other causes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from dpr_lab.effects import without_events
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.damage.disturbances import without_jumps
from dpr_lab.gap.damage.jumps import JUMP
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.known_torques import earlier_share, no_worse, with_other_noise
from dpr_lab.gap.rolling_shutter import explains_more, likeliest_shutter
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.state import Drafted


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of one property of the recordings, which the result of a search reveals."""

    correct: Callable[[Drafted], Drafted | None]
    """Function that returns the state with corrected recordings; None if no correction is needed."""
    better: Callable[[Drafted, Drafted], bool]
    """Function (previous state, corrected state) -> whether the search of the corrected recordings is used."""
    most: int = 1
    """Maximum number of corrections in succession."""


def _other_noise(state: Drafted) -> Drafted | None:
    """State with a smaller noise of known torques, or with none; None if the noise does not change."""
    changed = with_other_noise(state.recordings, state.problem, state.search.current)
    return changed and replace(state, recordings=changed)


def _earlier_torques(state: Drafted) -> Drafted | None:
    share = earlier_share(state.recordings, state.search.current)
    if not share:
        return None
    recordings, held_out = (runs.with_earlier_torques(share) for runs in (state.recordings, state.held_out))
    return replace(state, recordings=recordings, held_out=held_out)


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
    """Whether the reduction of chi2 exceeds the effect of the smaller number of readings.

    With effects that have internal states (hysteresis, backlash), the residual jumps if a segment begins at another
    instant.
    """
    model = state.search.current.fit
    problem, initial = recordings.cut(recordings.working_length)
    other = fit(problem, problem.with_zeros(model.estimate.changed(initial=initial)), (), iterations=20)
    level = max(1.0, model.chi2 / state.problem.evidence)
    return model.chi2 - other.chi2 > JUMP.gain + level * (state.problem.evidence - problem.evidence)


def _shutter(state: Drafted, model: Hypothesis) -> Drafted | None:
    shutter = likeliest_shutter(state.recordings, state.problem, model)
    return shutter and replace(state, recordings=state.recordings.with_shutter(shutter))


def _shutter_explains_more(before: Drafted, after: Drafted) -> bool:
    return before.recordings.shutter is not None or explains_more(before.search.current, after.search.current)


CORRECTIONS = (
    Correction(_other_noise, lambda before, after: True, most=2),
    Correction(_earlier_torques, lambda before, after: no_worse(before.search.current, after.search.current)),
    Correction(_jumps, lambda before, after: True),
    Correction(lambda state: _shutter(state, state.bare), _shutter_explains_more),
    Correction(lambda state: _shutter(state, state.search.current), _shutter_explains_more),
)
