"""Recordings that were read with another zero, unit, sign or order than they were written with: seen, and named.

Such a reading still makes curves, and a fit of them ends somewhere: with ratios that no masses have, or far from the
curves. What explains them ten times better is then the likely cause.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.errors import IdentificationError
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.identification.ratio_fit import RatioFit, short_fit
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MisreadSettings:
    """When a reading is doubted."""

    looked_at_s: float = 5.0
    """Of each run; a wrong reading is wrong from the start."""
    suspicious: float = 0.02
    """Residual over the spread of the angle. Rods alone reach 2e-4 on a clean plant, 0.002 and 0.065 on rigs with much
    friction; wrong readings of a clean plant start at 0.05."""
    hopeless: float = 0.3
    """The same, where nothing of the swing is left in the fit."""
    better: float = 10.0
    """Times that another reading's chi2 must be lower."""
    spare: float = 1.05
    """What the limits of the ratios are widened by: a ratio has an uncertainty."""


SETTINGS = MisreadSettings()


@dataclass(frozen=True, slots=True)
class Misreading:
    """Another way to read a recording."""

    cause: str
    angles: Callable[[Array, Array], tuple[Array, Array]]
    """theta1, theta2 as they would be, rad."""


MISREADINGS = (
    Misreading(
        "the zero of the angles is the other end (imported with the wrong --zero, or a wrong zero_counts)",
        lambda inner, outer: (inner + np.pi, outer + np.pi),
    ),
    Misreading("one rod's sign is turned (direction of one encoder)", lambda inner, outer: (-inner, outer)),
    Misreading(
        "the sign of joint 2 is turned (direction of its encoder)", lambda inner, outer: (inner, 2 * inner - outer)
    ),
    Misreading(
        'the angles of the outer rod are to the inner one (import with --angles relative, or joint2 = "relative")',
        lambda inner, outer: (inner, inner + outer - np.pi),
    ),
    Misreading(
        'the angles of the outer rod are to the vertical (import with --angles absolute, or joint2 = "absolute")',
        lambda inner, outer: (inner, outer - inner + np.pi),
    ),
    Misreading("inner and outer rod are exchanged (order of the columns, or of the encoders)", lambda a, b: (b, a)),
    Misreading("the angles are in degrees (import with --unit deg)", lambda a, b: (np.radians(a), np.radians(b))),
    Misreading(
        "the angles are in radians (import with --unit rad)",
        lambda a, b: (np.pi + np.degrees(a - np.pi), np.pi + np.degrees(b - np.pi)),
    ),
)


def refuse_misread(runs: Sequence[Run], rig: Rig) -> None:
    """Make sure that recordings can be of the rig.

    Raises:
        IdentificationError: they cannot; with the likely cause, which was tried.
    """
    looked_at = [run.between(-np.inf, np.max(run.t[:1], initial=0.0) + SETTINGS.looked_at_s) for run in runs]
    found = _fit(looked_at, rig)
    possible = found is not None and not impossible(found.ratios, rig)
    if found is not None and possible and _residual(found, looked_at) < SETTINGS.suspicious:
        return
    limit = np.inf if found is None else found.chi2_per_dof / SETTINGS.better
    causes = sorted(
        (other.chi2_per_dof, reading.cause)
        for reading, other in _otherwise(looked_at, rig)
        if other.chi2_per_dof < limit and _residual(other, looked_at) < SETTINGS.suspicious
    )
    if causes:
        best = min(chi2 for chi2, _ in causes)
        said = ", or ".join(cause for chi2, cause in causes if chi2 < SETTINGS.better * best)
        raise IdentificationError(
            f"these recordings are not of this rig as they are read; tried otherwise, they fit: {said}"
        )
    if found is None or not possible or _residual(found, looked_at) > SETTINGS.hopeless:
        raise IdentificationError(
            "these recordings are of no double pendulum with this L1"
            + (f": {impossible(found.ratios, rig)}" if found is not None and not possible else "")
            + "; another zero, sign, unit or order of the angles was tried and does not explain it: check the unit of"
            " time, L1 and g in the rig file, counts_per_rev, and that the arm is clamped"
        )


def refuse_impossible(ratios: Array, rig: Rig) -> None:
    """Make sure that (5,) ratios can be those of rods with masses.

    Raises:
        IdentificationError: they cannot.
    """
    if why := impossible(ratios, rig):
        raise IdentificationError(f"{why}: check zero, unit, sign and order of the angles, and L1 in the rig file")


def impossible(ratios: Array, rig: Rig) -> str:
    """Why no positive masses have (5,) ratios; empty for those that some have.

    With m2 at l2 on the rod and M >= m2 at the joint: d = m2 l2 L1 > 0, b >= m2 l2^2, a >= M L1^2, e1 >= M L1 g, so
    that a/b > (d/b)^2 and e1/b >= (d/b)^2 g/L1.
    """
    a, d, e1, *_ = ratios.tolist()
    least = d * d / SETTINGS.spare
    if not np.isfinite(ratios).all() or min(a, d, e1) <= 0:
        said = ", ".join(f"{name} = {value:.3g}" for name, value in zip(RATIOS, ratios.tolist(), strict=True))
        return f"no masses have {said}"
    if a < least:
        return f"no masses have a/b = {a:.3g} with d/b = {d:.3g}"
    if e1 < least * rig.g / rig.L1:
        return f"no masses have e1/b = {e1:.3g} with d/b = {d:.3g} and L1 = {rig.L1:g} m"
    return ""


def _otherwise(runs: Sequence[Run], rig: Rig) -> Iterator[tuple[Misreading, RatioFit]]:
    for reading in MISREADINGS:
        found = _fit([_read(run, reading) for run in runs], rig)
        if found is not None and not impossible(found.ratios, rig):
            yield reading, found


def _read(run: Run, reading: Misreading) -> Run:
    inner, outer = reading.angles(run.theta[:, 1], run.theta[:, 2])
    return replace(run, theta=np.column_stack([run.theta[:, 0], inner, outer]), counts=None)


def _fit(runs: Sequence[Run], rig: Rig) -> RatioFit | None:
    """The fit of a reading; None where it has no numbers."""
    with np.errstate(all="ignore"):
        try:
            found = short_fit(rig.nominal, [preprocess(run, rig) for run in runs], rig)
        except np.linalg.LinAlgError:
            return None
    return found if np.isfinite(found.chi2_per_dof) else None


def _residual(found: RatioFit, runs: Sequence[Run]) -> float:
    """Root mean square residual over the spread of the angle; of the worse rod."""
    measured = found.problem.joints.to_rods(found.problem.measured)
    sizes = [len(run.swing.t) for run in runs]
    spread = np.std(np.concatenate([part - part.mean(axis=0) for part in np.split(measured, np.cumsum(sizes)[:-1])]), 0)
    rms = np.sqrt(np.mean((measured - found.predicted) ** 2, axis=0))
    both = not all(run.setup.alone for run in runs)
    return float(np.max((rms / spread)[: 1 + both]))
