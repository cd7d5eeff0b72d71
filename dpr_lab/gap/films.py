"""Corrections of films for a rolling shutter and for a slowly moving camera, both estimated from a fitted model.

Rolling shutter (`dpr_lab.gap.screen.shutter`). The derivative of the corrected readings with respect to the delay is a
column of the linear problem. The other columns are those of the model and of the causes that every rig has: friction,
air drag and a tilted camera. Without these columns, the delay would be biased. Reading a picture takes at most as long
as a frame, which limits the delay.

Moving camera. If the camera rotates, or if the point that is used as the pivot moves, all angles of the picture change
together. The change is much slower than the swing, and differs between recordings. It is therefore modelled as noise,
and not as an effect of the rig. In each segment the error is a straight line with a random offset and slope
(`dpr_lab.fitting.whitening`). The standard deviation of this error is estimated from the residual of a fitted set by
restricted maximum likelihood. The standard deviation of the readings is estimated at the same time.

Source: Patterson & Thompson (1971), Recovery of inter-block information when block sizes are unequal, Biometrika 58.
"""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects.air_drag import AIR_DRAG_BOTH
from dpr_lab.effects.base_tilt import BASE_TILT
from dpr_lab.effects.coulomb import COULOMB
from dpr_lab.fitting.disturbance import restricted
from dpr_lab.fitting.estimate import effect_parameters
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis
from dpr_lab.gap.hypothesis.significance import segment_scatter
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.shutter import NORMALS, Lines, RollingShutter
from dpr_lab.gap.where.coordinates import beyond_fit


@dataclass(frozen=True, slots=True)
class FilmRules:
    """Settings of the tests for a rolling shutter and for a moving camera."""

    part: float = 0.1
    """Step of the numerical derivative, as a fraction of the largest delay."""
    share: float = 0.04
    """Minimum fraction of the excess chi-square that a correction for a rolling shutter must explain."""
    angles_rad: tuple[float, ...] = tuple(np.geomspace(1e-3, 0.1, 13).tolist())
    """Tested standard deviations of the rotation of the picture, rad: from the noise of a good film to 6 degrees."""


FILM = FilmRules()
ORDINARY = (*COULOMB, AIR_DRAG_BOTH, BASE_TILT)
"""Effects that every filmed rig has."""


def likeliest_shutter(recordings: Recordings, problem: Problem, model: Hypothesis) -> RollingShutter | None:
    """Return the rolling shutter whose correction reduces the chi2 of a model most.

    The result is None for readings of encoders, or if no correction reduces chi2 enough.
    """
    if not recordings.may_be_films:
        return None
    improvements = [_improved(recordings, problem, model, lines) for lines in NORMALS]
    gain, shutter = max(improvements, key=lambda improved: improved[0])
    least = max(THRESHOLDS.chance * model.residuals.independent_noise, FILM.share * model.bounded_excess)
    return shutter if gain > least else None


def shutter_explains_more(without: Hypothesis, corrected: Hypothesis) -> bool:
    """Return whether the correction for a rolling shutter significantly reduces the cost.

    Fits with different numbers of segments are not comparable; the result is then False.
    """
    if len(without.fit.linear.chi2_by_segment) != len(corrected.fit.linear.chi2_by_segment):
        return False
    chance = min(corrected.chance, segment_scatter(without, corrected))
    return without.cost - corrected.cost > chance + PENALTY.parameter * corrected.inflation


def _improved(
    recordings: Recordings, problem: Problem, model: Hypothesis, lines: Lines
) -> tuple[float, RollingShutter]:
    """Return the reduction of chi2 by the best delay, and the shutter with this delay.

    `lines` is the direction in which the lines of a picture are read.
    """
    rate_hz = max(record.run.rate_hz for record in recordings.records)
    limit = 1 / (recordings.rods_length * rate_hz)  # reading the length of the rods takes one frame; s/m
    shutters = (RollingShutter(lines=lines, delay_s_per_m=sign * FILM.part * limit) for sign in (1, -1))
    corrected = (recordings.with_shutter(shutter) for shutter in shutters)
    after, before = (runs.cut(recordings.working_length)[0].measured for runs in corrected)
    columns = problem.whitened((before - after)[:, :, None] / (2 * FILM.part * limit))
    others = [parameter for effect in ORDINARY for parameter in effect_parameters(effect, limits=problem.limits)]
    free = (*model.fit.free, *(parameter for parameter in others if parameter not in model.fit.free))
    linear = linearise(problem, model.estimate, free)
    space = beyond_fit(linear, range(len(free)), linear.projected(columns))
    delay = space.solution(np.array([[-limit], [limit]]))
    return space.reduction(delay), RollingShutter(lines=lines, delay_s_per_m=float(delay[0]))


def likeliest_camera(recordings: Recordings, problem: Problem, model: Hypothesis) -> float:
    """Estimate the standard deviation of the rotation of a film's picture by maximum likelihood, rad.

    The result is 0 for readings of encoders, or if the likelihood of a fixed camera is not significantly lower.
    """
    if not recordings.may_be_films:
        return 0.0
    predicted = problem.predict(model.estimate)
    slopes = problem.slopes(model.estimate, model.fit.free, predicted)

    def cost(angle_rad: float) -> float:
        squares, volume = restricted(replace(problem, camera_rad=angle_rad), model.fit, predicted, slopes)
        return problem.evidence * float(np.log(squares)) + volume

    best = min(FILM.angles_rad, key=cost)
    return best if cost(0.0) - cost(best) > THRESHOLDS.chance else 0.0
