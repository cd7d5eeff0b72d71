"""Limits of the effort of a search: iterations, initial shapes, and repeated fits."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Effort:
    """Numbers of iterations and of initial shapes, and limits for repeated fits."""

    rough: int = 6
    """Maximum number of iterations of a fit far from the noise."""
    fine: int = 15
    """Maximum number of iterations of a fit near the noise."""
    preview: int = 3
    """Number of iterations from each of several shapes, before the best of these fits is continued."""
    thorough: int = 30
    """Maximum number of iterations from the best of several shapes."""
    short: int = 12
    """Maximum number of iterations of a fit to short segments, and of its continuation."""
    achieved: float = 0.5
    """Minimum ratio of the achieved to the predicted reduction of chi2.

    Below this ratio, a fit is repeated from short segments.
    """
    outstanding: float = 5.0
    """Ratio of the chi2 of a segment to the median of all segments above which the segment may cause a local
    minimum."""
    nowhere: float = 0.99
    """Ratio of chi2 with an effect to chi2 without it above which the fit counts as failed."""
    starts: int = 2
    """Maximum number of shapes from which an effect with a high score is fitted.

    In 16 such fits from four shapes, the third and fourth shape never gave the lowest chi2.
    """
    replacements: int = 2
    """Number of candidates that are fitted as replacements of each effect."""
    nearly: float = 0.9
    """Minimum cosine similarity, and minimum score relative to the replaced effect, of further replacements while a
    residual remains."""
    nearly_common: float = 0.5
    """Value of `nearly` for a common effect, such as a zero error, also if only noise remains."""
    hopeless: float = 2.0
    """Maximum increase of the criterion by an alternative whose fit is repeated from other initial values, relative to
    the largest change by chance."""
    leading: float = 0.5
    """Minimum score of an effect, relative to the best score, for which several of its shapes are fitted."""


EFFORT = Effort()
