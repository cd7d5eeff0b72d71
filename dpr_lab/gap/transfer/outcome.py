"""Outcome of the test of the selected effects on held-out data."""

from collections.abc import Mapping
from dataclasses import dataclass

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.diagnosis import Basis
from dpr_lab.gap.result.evidence import Closing
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.transfer.lone_recording import LoneRecording


@dataclass(frozen=True, slots=True)
class TransferSettings:
    """Settings of the test on held-out data."""

    beyond_chance: float = NORMAL_Q90
    """Number of standard errors beyond which a sum of reductions is significant.

    Without an effect, one sum in twenty exceeds it.
    """
    least_groups: int = 4
    """Minimum number of groups of segments for a test by signed ranks."""
    clear: float = 10.0
    """Minimum factor by which chi2 must decrease to be significant if there are fewer groups of segments.

    The 95 % point of the F distribution with three and three degrees of freedom is 9.3 (decision 70).
    """
    kept: float = 0.5
    """Minimum ratio of the share of the gap closed on held-out data to the share closed in the fitted recordings.

    An effect passes if the upper limit of its interval reaches this ratio.
    """
    comparable: float = 0.5
    """Minimum share of the gap that all effects together close on held-out data for a reduction of `kept`.

    If all effects together close a smaller share on held-out data than in the fitted recordings, `kept` is multiplied
    by the ratio of the two shares.
    """
    least_fitted: float = 0.5
    """Lower limit of the share closed in the fitted recordings, where it is the denominator of this ratio."""
    gap_from: float = 0.25
    """Minimum ratio of the excess chi2 to the chi2 of the noise for a meaningful share.

    At smaller ratios the noise, not the effect, determines the share.
    """
    unproven: float = 0.5
    """Factor on the probability of an effect that does not carry over, so that the probability is at most one half."""
    weakly_tested: float = 0.87
    """Factor on the probability of an effect that fails the test on the quarters of a single release and leaves only
    noise.

    It is the share of correct effects among those that failed this test in blind trials (decision 61). If a remainder
    is left, the factor is `unproven` (decision 96).
    """
    untested: float = 0.65
    """Maximum factor on the probability of an effect with several parameters in one release of a single rod.

    Such an effect also follows many causes outside the library: 42 % of these effects were correct (decision 123).
    """
    oversized: float = 0.1
    """Factor on the probability of an effect with an impossible size; another cause is then more probable."""
    wildest: float = 1e12
    """Maximum chi2 of a segment; also the value for a segment that cannot be simulated."""


TRANSFER = TransferSettings()


@dataclass(frozen=True, slots=True)
class WorseFreeRun:
    """Errors of free runs that the selected effects increase, over the time that the bare model can predict."""

    before_rad: float
    """Error of the bare model: geometric mean over the runs of the rms error, rad."""
    after_rad: float
    """Error of the model with the effects: geometric mean over the runs of the rms error, rad."""
    until_s: float
    """Time of the longest comparison, s after the beginning of the recording."""


@dataclass(frozen=True, slots=True)
class Transfer:
    """Performance of the selected effects on held-out data."""

    basis: Basis
    tested: bool
    """Whether there are held-out runs, or enough segments to predict some of them from the others."""
    closed: Interval
    """Share of the gap that all effects together close."""
    gap_ratio: float
    """Ratio of the residual of the bare model on held-out data to the noise, both rms."""
    closing: tuple[Closing, ...]
    """Gap after each added effect, on data that were not fitted; the first entry is the bare model."""
    left_out: Mapping[str, Interval]
    """Share of the gap that closes in a fitted run when it is predicted from the other runs, by run."""
    held_out: Mapping[str, Interval]
    """Share of the gap that closes in a held-out run, by run."""
    effects: Mapping[str, Mapping[str, Interval]]
    """For each effect and run: share of the gap without the effect that the effect closes."""
    withdrawn: tuple[str, ...]
    """Effects that do not improve the prediction of recordings that were not fitted."""
    unproven: tuple[str, ...]
    """Effects that do not improve the prediction of a quarter of the only release from its other quarters.

    They stay in the model, because the quarters differ in amplitude.
    """
    oversized: tuple[str, ...]
    """Effects whose size is impossible on any rig or is typical of another cause."""
    worse_free_run: WorseFreeRun | None
    """Errors of free runs without and with the effects, if the effects increase them; otherwise None.

    The free runs follow the held-out runs or, if there are none, the fitted runs.
    """
    lone: LoneRecording | None = None
    """The only fitted recording with a remainder; None if there is none."""
    untested: tuple[str, ...] = ()
    """Effects with several parameters whose form one release of a single rod does not test."""
    too_short: bool = False
    """Whether the only release has fewer groups of segments than `TransferSettings.least_groups`."""
