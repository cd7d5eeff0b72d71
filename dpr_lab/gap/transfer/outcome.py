"""Outcome of the test on held-out recordings, and its effect on the probabilities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.result.diagnosis import Basis
from dpr_lab.gap.transfer.lone_recording import LoneRecording
from dpr_lab.gap.transfer.out_of_sample import GapReduction


@dataclass(frozen=True, slots=True)
class TransferSettings:
    """Settings of the test on held-out recordings."""

    beyond_chance: float = NORMAL_Q90
    """Standard errors of a sum of reductions: exceeded by chance in one of twenty cases."""
    kept: float = 0.5
    """Minimum ratio of the share closed on held-out data to the share closed in the fitted recordings; an effect whose
    interval reaches it is not refuted.
    """
    gap_from: float = 0.25
    """Minimum ratio of the excess chi2 to the chi2 of the noise for which the effect, not the noise, determines a
    share.
    """
    unproven: float = 0.5
    """Factor on the probability of an effect that does not carry over; the result is at most one half."""
    oversized: float = 0.1
    """Factor on the probability of an effect with an impossible size: another cause is then more probable."""
    worse: float = 1.1
    """Factor by which the named effects may increase the error of free runs, besides the noise of the first readings.
    """
    unpredictable: float = 2.0
    """Increase of the error of free runs that counts as chance, in its standard deviations due to the noise of their
    first readings."""
    followed_rad: float = 0.3
    """Maximum error of a free run of the bare model, rms from its beginning, for which free runs are compared, rad.
    Beyond it, chaos dominates.
    """
    followed_s: float = 0.6
    """Minimum time of this comparison, since the beginning of the recording."""
    wildest: float = 1e12
    """Maximum chi2 of a segment; used for a segment that cannot be simulated."""


TRANSFER = TransferSettings()


@dataclass(frozen=True, slots=True)
class WorseFreeRun:
    """Error of free runs that the named effects increase, up to the time that the bare model can follow."""

    before_rad: float
    """Error of the bare model: rms of a run, geometric mean over the runs, rad."""
    after_rad: float
    """Error of the model with the effects, rad."""
    until_s: float
    """Time of the longest comparison, since the beginning of the recording, s."""


@dataclass(frozen=True, slots=True)
class Transfer:
    """Performance of the named effects on held-out recordings."""

    basis: Basis
    tested: bool
    """Whether there are enough segments to predict some segments from the other segments."""
    closed: GapReduction
    """Share of the gap closed by all effects together."""
    gap_ratio: float
    """Ratio of the residual of the bare model on these data to the noise, both rms."""
    closing: tuple[tuple[str, float, float], ...]
    """Added effect ("" for none); remaining gap, rms of a reading, rad; share closed so far; on data that were not
    fitted.
    """
    left_out: Mapping[str, GapReduction]
    """Share of the gap closed in each fitted run, predicted from the other runs."""
    held_out: Mapping[str, GapReduction]
    """Share of the gap closed in each held-out run."""
    effects: Mapping[str, Mapping[str, GapReduction]]
    """Effect -> run -> share of the gap without the effect that the effect closes."""
    withdrawn: tuple[str, ...]
    """Effects that do not improve the prediction of recordings that were not fitted."""
    unproven: tuple[str, ...]
    """Effects that do not improve the prediction of a quarter of the only release from its other quarters. They stay in
    the model, because the quarters differ in amplitude.
    """
    oversized: tuple[str, ...]
    """Effects whose size is impossible on any rig, or is typical of another cause."""
    worse_free_run: WorseFreeRun | None
    """Error of free runs without and with the effects, if the effects increase it; otherwise None. On the held-out
    runs, without these on the fitted ones.
    """
    lone: LoneRecording | None = None
    """The only fitted recording with a remainder, if there is one."""

    def judged(self, posteriors: Sequence[EffectPosterior]) -> tuple[EffectPosterior, ...]:
        """Probabilities of the effects; reduced for those that fail a test."""
        doubtful = {*self.withdrawn, *self.unproven}
        if self.worse_free_run or self.lone or not self.tested or self.closed.estimate < 0.0:
            doubtful |= {posterior.name for posterior in posteriors}
        factors = dict.fromkeys(doubtful, TRANSFER.unproven) | dict.fromkeys(self.oversized, TRANSFER.oversized)
        return tuple(
            replace(posterior, probability=factors.get(posterior.name, 1.0) * posterior.probability)
            for posterior in posteriors
        )
