"""Effort of a search: iterations, initial shapes, and limits for further attempts."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Effort:
    """Number of iterations and of initial shapes of the fits, and limits for further attempts."""

    rough: int = 6
    """Maximum number of iterations of a fit far from the noise."""
    fine: int = 15
    """Maximum number of iterations of a fit near the noise."""
    preview: int = 3
    """Number of iterations from each of several shapes. The best of these fits is continued."""
    thorough: int = 30
    """Maximum number of iterations from the best of several shapes."""
    short: int = 12
    """Maximum number of iterations from short segments."""
    achieved: float = 0.5
    """Minimum ratio of the achieved to the predicted reduction of chi2.

    Below it a fit is repeated from shorter segments.
    """
    outstanding: float = 5.0
    """Ratio of the chi2 of a segment to the median of all segments, above which it may cause a local minimum."""
    nowhere: float = 0.99
    """Ratio of chi2 with an effect to chi2 without it above which the fit of the effect has failed."""
    starts: int = 2
    """Maximum number of initial shapes for the fits of an effect with a high score.

    In 16 such fits from four shapes, the third and fourth shape never gave the lowest chi2.
    """
    replacements: int = 2
    """Number of candidates that are fitted as replacements of each effect."""
    nearly: float = 0.9
    """Minimum cosine similarity and relative score of further replacements, while a residual remains."""
    nearly_common: float = 0.5
    """Value of `nearly` for a common effect, such as a zero error, also if only noise remains."""
    hopeless: float = 2.0
    """Maximum increase of the criterion at which the fit of an alternative is repeated from other starting points,
    relative to the largest change by chance."""
    leading: float = 0.5
    """Minimum score of an effect, relative to the best score, for which several of its shapes are fitted."""


EFFORT = Effort()
