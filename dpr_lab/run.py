"""A run: one release recorded, or one table imported."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.rig import AddedMass

LOSS_CAUSES = ("device_overrun", "crc", "framing", "tick_gap")
"""Why a sample can be missing: the device was late, the link damaged it, or it never arrived."""


@dataclass(frozen=True, slots=True)
class Run:
    """What was measured during one release.

    Time is the device's: t = (tick - release tick) / rate, so t = 0 is the release, and the samples with t < 0 are the
    rest before it. Missing samples are simply absent from `t`; nothing is resampled.
    """

    name: str
    """Short name for tables and figures; the file's stem where there is one."""
    t: NDArray[np.float64]
    """(n,) device time since the release, s, strictly increasing."""
    theta: NDArray[np.float64]
    """(n, 3) measured absolute angles of arm, inner and outer rod, rad; 0 = upright, pi = hanging."""
    counts: NDArray[np.int64] | None
    """(n, 3) unwrapped position counters; None for an imported table of angles."""
    pose: str | None
    """Name of the pose asked for."""
    rig_name: str
    rig_sha256: str
    rate_hz: float
    """Nominal sample rate; the real instants are in `t`."""
    added_mass: AddedMass | None = None
    """The known mass that was clamped on, if any."""
    complete: bool = True
    """Whether the file was finished; a recovered or cut one is not."""
    lost: Mapping[str, int] = field(default_factory=dict)
    """Samples lost, by cause (`LOSS_CAUSES`)."""
    file: Path | None = None
    sha256: str = ""
    notes: tuple[str, ...] = ()
    """What the reader or importer wants the operator to know (gaps kept, doubled rows left out)."""

    @property
    def rest(self) -> NDArray[np.float64]:
        """(m, 3) angles before the release, rad; m = 0 when none were recorded."""
        return self.theta[self.t < 0]

    @property
    def swing(self) -> "Run":
        """The same run from the release on."""
        return self._cut(self.t >= 0)

    @property
    def duration(self) -> float:
        """Time from release to the last sample, s."""
        return float(self.t[-1]) if len(self.t) else 0.0

    def between(self, start: float, stop: float) -> "Run":
        """The samples with start <= t < stop; t is kept as it is."""
        return self._cut((self.t >= start) & (self.t < stop))

    def _cut(self, keep: NDArray[np.bool_]) -> "Run":
        counts = None if self.counts is None else self.counts[keep]
        return replace(self, t=self.t[keep], theta=self.theta[keep], counts=counts)


def refuse_repeated(runs: Sequence[Run]) -> None:
    """Make sure that no recording counts twice, or is held out from a fit that it takes part in.

    Raises:
        RunError: two runs hold the same recording, by the hashes of their files.
    """
    seen: dict[str, Run] = {}
    for run in runs:
        if run.sha256 in seen:
            raise RunError(f"{run.file}: the same recording as {seen[run.sha256].file}: give each run once")
        if run.sha256:
            seen[run.sha256] = run
