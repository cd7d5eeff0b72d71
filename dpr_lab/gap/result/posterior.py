"""Fitted set of effects that may be the cause, with the uncertainty of its values."""

from typing import Annotated

import numpy as np
from pydantic import Field

from dpr_lab.arrays import Array
from dpr_lab.identification.scaling.scale import ModelPart


class PosteriorComponent(ModelPart):
    """Fitted set of effects, with its probability and the normal distribution of its values."""

    probability: Annotated[float, Field(ge=0, le=1)]
    """Probability of the set among the fitted sets, given that the cause is in the library."""
    ratios: dict[str, float]
    """Ratios a/b, d/b, e1/b, c1/b, c2/b; also b, kg m^2, if the recordings determine b."""
    effects: dict[str, dict[str, float]]
    """Value of each parameter, SI, by effect and parameter; at the b in `ratios`, or else at that of the diagnosis."""
    free: list[str]
    """Names of the fitted values, in the order of the covariance: a ratio, or `effect.parameter`."""
    covariance: list[list[float]]
    """(free, free) covariance of the fitted values, SI."""
    between: list[list[float]] = []
    """(free, free) covariance of the values between recordings, SI, without the noise of the readings.

    It describes how the values of another recording differ from these values. It is zero if the recordings do not
    differ significantly, and empty in a file of an older version.
    """
    left_out: list[list[float]] = []
    """(recordings, free) values fitted without each recording in turn, SI.

    Empty in a file of an older version, and for a single recording.
    """

    @property
    def predictive(self) -> Array:
        """(free, free) covariance of the values of a new recording."""
        shape = len(self.free), len(self.free)
        return np.reshape(self.covariance, shape) + (np.reshape(self.between, shape) if self.between else 0.0)
