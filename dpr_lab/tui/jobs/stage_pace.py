"""Estimate of the remaining time of a job with stages."""

from collections.abc import Collection, Mapping


class StagePace:
    """Estimator of the remaining time of a job.

    The estimate is the sum of typical durations of the remaining stages, scaled by the durations of finished stages.

    Args:
        typical: typical duration of each stage, s, in the order of the stages
        steady: stages whose duration does not depend on the result; their durations determine the scale
        began: start of the first stage, s
    """

    def __init__(self, typical: Mapping[str, float], steady: Collection[str], began: float) -> None:
        self._typical, self._steady = typical, steady
        self._stage, self._since, self._compiled = next(iter(typical)), began, False
        self._took = self._expected = 0.0

    def begin(self, stage: str, now: float) -> None:
        """Start the next stage."""
        if self._stage in self._steady and not self._compiled:
            self._took += now - self._since
            self._expected += self._typical[self._stage]
        self._stage, self._since, self._compiled = stage, now, False

    def compiling(self, now: float) -> None:
        """Exclude the compilation of a kernel, which now starts, from the estimate."""
        self._since, self._compiled = now, True

    def left(self, now: float) -> float | None:
        """Return the estimated remaining time, s.

        The result is None if the current stage takes longer than usual.
        """
        pace = self._took / self._expected if self._took > 0 else 1.0
        names = list(self._typical)
        current, *coming = (pace * self._typical[name] for name in names[names.index(self._stage) :])
        remaining = current - (now - self._since)
        return remaining + sum(coming) if remaining >= 0 else None
