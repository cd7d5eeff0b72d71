"""Calibration of the conversion of costs to probabilities, and the probability of a cause outside the library."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Calibration:
    """Conversion of costs to probabilities, calibrated on blind trials by `benchmarks/calibrate_diagnosis.py`."""

    temperature: float = 3.0
    """Divisor of differences of the log predictive density in the exponent of a probability."""
    half_unexplained: float = 0.35
    """Unexplained share of the excess at which causes outside and inside the library are equally probable.

    The value applies if the rms of the remainder equals the noise.
    """
    far: float = 8.0
    """Remainder, in units of the noise, above which the evidence for a cause outside the library no longer increases.

    On real rigs, small unknown causes change the readings by more than the noise of the encoders.
    """
    steepness: float = 4.0
    """Exponent of the unexplained share in the odds of an outside cause."""
    imitates: float = 0.25
    """Odds that a part of an unknown cause is mistaken for an effect.

    The value applies if effect and remainder are equally large and far above the noise.
    """
    compensates: float = 0.009
    """Own share at which a secondary effect is equally likely to be a cause or a compensation.

    A compensation makes up for the inexact form of a larger effect. Own shares are at least `least_own`, so the odds of
    a compensation are at most 0.81.
    """
    compensates_with_remainder: float = 0.11
    """The same for any effect that other forms can replace while a residual remains.

    It is the geometric mean of the largest own share of a compensation, 0.043, and of the smallest own share of a true
    effect, 0.29, in 14 trials (decision 7).
    """
    least_own: float = 0.01
    """Lower limit of the own share, because the linear fits from which it is computed are inexact."""
    sure: float = 0.98
    """Probability of "no gap" if the recordings show none, and of "unexplained" if no effect explains the gap."""
    outside_when_closed: float = 0.02
    """Minimum probability of a cause outside the library, if only noise remains."""
    drifting: float = 0.1
    """Prior odds of a friction drift against a dissipative torque that depends on speed.

    They apply to recordings of a single decay, which do not distinguish the two. Every rod has air drag, so a drift is
    less probable.
    """
    unseen: float = 0.5
    """Probability of "no gap" if most effects are undetectable in the recordings."""
    least_listed: float = 1e-9
    """Minimum probability of a listed alternative."""
    alternatives: int = 5
    """Maximum number of alternatives of each named effect."""
    hidden: float = 0.5
    """Minimum detectable size of an additional parameter of a richer form, relative to the effect, that counts as
    undetectable.

    If all additional parameters are undetectable, the richer form belongs to the class of the effect.
    """
    negligible: float = 50.0
    """Maximum difference of log probabilities; larger differences are clipped."""
    least_left: float = 1e-6
    """Lower limit of the unexplained share of the excess, because of the error of the integrator."""

    def unit(self, inflation: float) -> float:
        """Return the increase of cost by which the probability falls by the factor e."""
        return 2 * inflation * self.temperature

    def odds_of_compensation(self, own_share: float, *, remainder: bool = False) -> float:
        """Return the odds that an effect with a given own share is a compensation and not a cause.

            (half / own)^2

        Args:
            own_share: fraction of the reduction by the effect that no other form of the other effects explains
            remainder: whether a residual remains, and other forms can replace the effect
        """
        half = self.compensates_with_remainder if remainder else self.compensates
        return (half / max(own_share, self.least_own)) ** 2


CALIBRATION = Calibration()


def probability_outside(odds: float, calibration: Calibration = CALIBRATION) -> float:
    """Return the probability of a cause outside the library from its odds."""
    return max(odds / (1 + odds), calibration.outside_when_closed)


def odds_outside(
    unexplained: float,
    remainder: float,
    unique: float = math.inf,
    compensation: float = 0.0,
    calibration: Calibration = CALIBRATION,
) -> float:
    """Return the odds of a cause outside the library.

        (unexplained / half)^steepness * m + imitates * unexplained / unique * m / far + compensation,
        m = min(remainder / noise, far)

    1. First term: if the library lacks the true law, the unexplained share does not depend on the ratio of gap to
       noise. In contrast, the small unknown causes of every rig leave a remainder of about the noise, for any size of
       the gap, unless the noise is much smaller.
    2. Second term: an effect that explains no more than the remainder may imitate a part of the unknown cause.
    3. Third term: an effect may compensate for the inexact form of another one (`Calibration.odds_of_compensation`).

    Args:
        unexplained: share of the excess that is not explained
        remainder: rms of the unexplained residual, in units of the noise; zero if only noise remains
        unique: share of the excess that only the effect explains; infinite for the gap as a whole
        compensation: odds of a compensation
        calibration: calibration of the probabilities
    """
    size = min(remainder, calibration.far)
    of_gap = (unexplained / calibration.half_unexplained) ** calibration.steepness * size
    imitated = unexplained / max(unique, calibration.least_left)
    return float(of_gap + calibration.imitates * imitated * size / calibration.far + compensation)
