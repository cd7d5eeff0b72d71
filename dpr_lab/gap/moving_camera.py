"""Film from a camera that moves slowly, so that the zero of the angles changes.

If the picture turns, or if the point that counts as the pivot moves, all angles of the picture change together. The
change is much slower than the swing, and it is different in each recording. It is therefore part of the noise, and no
effect of the rig. In each segment the error is a straight line of random value and slope (`dpr_lab.fitting.whitening`).
Its standard deviation is the restricted maximum likelihood estimate from the residual of a fitted set. The standard
deviation of the readings is free in this estimate.

Source: Patterson & Thompson (1971), Recovery of inter-block information when block sizes are unequal, Biometrika 58.
"""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.fitting.disturbance import restricted
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.screen.recordings import Recordings


@dataclass(frozen=True, slots=True)
class CameraRules:
    """Tested angles of the picture."""

    angles_rad: tuple[float, ...] = tuple(np.geomspace(1e-3, 0.1, 13).tolist())
    """Tested standard deviations of the angle: from the noise of a good film to 6 degrees."""


CAMERA = CameraRules()


def likeliest_camera(recordings: Recordings, problem: Problem, model: Hypothesis) -> float:
    """Return the likeliest standard deviation of the angle of the picture, rad.

    The result is 0 if encoders gave the readings, or if the likelihood of a fixed camera is not significantly lower.
    """
    if not recordings.may_be_films:
        return 0.0
    predicted = problem.predict(model.estimate)
    slopes = problem.slopes(model.estimate, model.fit.free, predicted)

    def cost(angle_rad: float) -> float:
        squares, volume = restricted(replace(problem, camera_rad=angle_rad), model.fit, predicted, slopes)
        return problem.evidence * float(np.log(squares)) + volume

    best = min(CAMERA.angles_rad, key=cost)
    return best if cost(0.0) - cost(best) > THRESHOLDS.chance else 0.0
