"""Comparison of the free runs before and after correction.

An effect that closes the gap of segments but increases the error of the free runs is not confirmed. Each run is
compared up to the time at which chaos dominates the error of the bare model. The geometric mean of the errors over the
runs is used, because it weights relative changes equally, so that the most chaotic run does not decide alone.

Source: Fleming & Wallace (1986), How not to lie with statistics, Communications of the ACM 29, 218-221.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.gap.transfer.free_run import FreeRunError
from dpr_lab.gap.transfer.outcome import WorseFreeRun


@dataclass(frozen=True, slots=True)
class WorseFreeRunRules:
    """Limits of the comparison of free runs."""

    worse: float = 1.1
    """Maximum factor by which the selected effects may increase the error of free runs.

    An increase that the noise of the first readings explains is allowed in addition.
    """
    unpredictable: float = 2.0
    """Additional error that is allowed, in units of the error that the noise of the first readings causes."""
    followed_rad: float = 0.3
    """Maximum rms error of a free run of the bare model, from its beginning, up to which free runs are compared, rad.

    Beyond this error, chaos dominates.
    """
    followed_s: float = 0.6
    """Minimum duration over which free runs are compared, s after the beginning of the recording."""


WORSE = WorseFreeRunRules()


def worse_free_run(
    before: Mapping[str, FreeRunError],
    after: Mapping[str, FreeRunError],
    noise: Mapping[str, FreeRunError],
    compared: Collection[str],
) -> WorseFreeRun | None:
    """Return the free-run errors before and after correction if they increase, otherwise None.

    Args:
        before: error of the free run of the bare model, by run
        after: error of the free run with the effects, by run; half a turn where it cannot be simulated
        noise: part of `before` that is expected from the noise of the first readings
        compared: names of the runs
    """
    squares, ends = [], []
    for name in compared:
        end = before[name].followed_s(WORSE.followed_rad) if name in before else 0.0
        if end >= WORSE.followed_s:
            errors = [runs[name].until(end).squares for runs in (before, after, noise)]
            squares.append([float(np.mean(np.where(np.isfinite(error), error, np.pi**2))) for error in errors])
            ends.append(end)
    if not ends:
        return None
    logs = np.log(np.maximum(squares, np.finfo(np.float64).tiny))
    of_before, of_after, of_noise = np.exp(np.mean(logs, axis=0)).tolist()
    if of_after <= WORSE.worse**2 * of_before + WORSE.unpredictable**2 * of_noise:
        return None
    return WorseFreeRun(of_before**0.5, of_after**0.5, max(ends))
