"""Objective of a plan: weighted bits about causes, library, ratios and limits.

Each limit of the rig (`dpr-lab accept`) is a goal of the plan: the releases should decide whether the rig passes or
fails. The test of a limit uses a 90 % interval, 1.645 standard deviations on either side. The quantity is assumed to be
at half its limit, or in the middle of its range. On average it then passes if the half width of the interval is smaller
than the distance from the limit. A friction limit also requires a recording in which the joint reaches the speed of the
limit in both directions. A limit for free runs is compared with the median of the recorded errors.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.acceptance.limits import Limits, free_run_quantity, friction_quantity
from dpr_lab.acceptance.median_error import undecided
from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.evidence.joint_friction import GRID, curve_basis, linear_torque
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.planning.information import reached_speeds
from dpr_lab.planning.knowledge import Knowledge, schur_complement
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import LimitForecast
from dpr_lab.planning.worth.criteria import (
    WORTH,
    OpenPairs,
    cause_bits,
    detectable,
    is_detectably_richer,
    library_bits,
    open_bits,
    ratio_bits,
    shown_ratio_std,
)


@dataclass(frozen=True, slots=True)
class Gain:
    """Expected information of each part of the objective, (...,), bits, without weights."""

    causes: Mapping[tuple[str, str], Array]
    """Expected information about each undecided pair of causes, bits."""
    open_effects: Array
    """Expected information on the presence of the effects that are not excluded, bits."""
    library: Array
    ratios: Array
    limits: Array

    @property
    def weighed(self) -> Array:
        """Weighted sum of the bits."""
        library = WORTH.library if self.causes else 1.0
        others = WORTH.ratios * self.ratios + WORTH.limits * self.limits
        return sum(self.causes.values(), self.open_effects) + library * self.library + others


@dataclass(frozen=True, slots=True)
class Objective:
    """Objective that a plan maximises, given the current knowledge."""

    known: Knowledge
    pairs: tuple[OpenPairs, ...]
    """Candidate causes of each named effect that a release can show."""
    before: tuple[Array, ...]
    """(n, n) D^2 between the causes from the runs recorded so far, for each named effect."""
    limits: Limits
    """Limits that the rig must satisfy."""

    @classmethod
    def of(cls, known: Knowledge, limits: Limits | None = None) -> "Objective":
        """Create the objective from the current knowledge and the limits of the rig."""
        pairs = tuple(pair for causes in known.causes if (pair := OpenPairs.of(known, causes)).names)
        before = tuple(pair.distances(known.information) for pair in pairs)
        return cls(known, pairs, before, limits or Limits())

    def gained(self, F: Array) -> list[Array]:
        """Return the (..., n, n) increases of the squared distances d^2 between the causes, for each named effect.

        F is the information after further releases.
        """
        added = [pair.distances(F) - before for pair, before in zip(self.pairs, self.before, strict=True)]
        return [np.maximum(D2, 0.0) / CALIBRATION.temperature for D2 in added]

    def separated(self, F: Array) -> list[Array]:
        """Return the (n, n) increases of d^2 with the rule by which a diagnosis leaves out richer forms.

        Readings under a named effect never contradict a richer form, which contains this effect. If an additional
        amplitude of the richer form is detectable at a given share of the named size, a diagnosis leaves the form out.
        """
        gained = self.gained(F)
        for pair, d2 in zip(self.pairs, gained, strict=True):
            for i, j in np.ndindex(*d2.shape):
                if is_detectably_richer(self.known, F, pair.names[i], pair.names[j]):
                    d2[i, j] = WORTH.certain
        return gained

    def bits(self, gained: list[Array]) -> dict[tuple[str, str], Array]:
        """Return the expected bits about each undecided pair, given the result of `gained`."""
        of_each = map(cause_bits, self.pairs, gained)
        return {pair: bits for open_pair in of_each for pair, bits in open_pair.items()}

    def gain(self, F: Array) -> Gain:
        """Return the bits of each part of the objective for the Fisher information F, (..., k, k)."""
        known, matrices = self.known, F.reshape(-1, *F.shape[-2:])
        limits = np.reshape([goal_bits(known, matrix, self.limits) for matrix in matrices], F.shape[:-2])
        causes = self.bits(self.gained(F))
        return Gain(causes, open_bits(known, F), library_bits(known, F), ratio_bits(known, F), limits)


@dataclass(frozen=True, slots=True)
class Goal:
    """A limit of the rig, and the expected accuracy of the limited quantity."""

    quantity: str
    """Name of the limited quantity, as in `dpr-lab accept`."""
    unit: str
    """SI unit of the quantity."""
    reach: float | None
    """Half width of the expected 90 % interval; None if the quantity is not detectable."""
    room: float
    """Distance from half the limit to the limit, or from the middle of a range to its ends."""
    single: bool = True
    """Whether the interval of `accept` refers to one shape of an effect.

    An interval over all shapes is wider than `reach`.
    """


def goals(known: Knowledge, F: Array, limits: Limits) -> list[Goal]:
    """Return one goal for each limit on an effect, a friction torque or a ratio.

    Args:
        known: the current knowledge
        F: (k, k) information about the unknowns
        limits: limits that the rig must satisfy
    """
    return [*_of_effects(known, F, limits), *_of_friction(known, F, limits), *_of_ratios(known, F, limits)]


def goal_bits(known: Knowledge, F: Array, limits: Limits) -> float:
    """Return the information about the limits, bits.

    The result is the sum of -log2(w / d) over all limits, where w is the half width of the interval of the limited
    quantity, and d the distance of this quantity from the limit. A quotient w / d below one half counts as one half.
    """
    shares = [goal.reach / goal.room for goal in goals(known, F, limits) if goal.reach is not None]
    return float(np.sum(-np.log2(np.maximum(shares, 0.5)))) if shares else 0.0


def limit_forecasts(
    known: Knowledge, F: Array, limits: Limits, releases: Sequence[CandidateRelease] = ()
) -> list[LimitForecast]:
    """Forecast which limits the releases will show to be met or violated.

    Args:
        known: the current knowledge
        F: (k, k) information after the releases
        limits: limits that the rig must satisfy
        releases: the releases; a friction limit also requires that the joint reaches the speed of the limit in one of
            them or in an earlier recording
    """
    slow = _too_slow(known, limits, releases)
    of_goals = [
        LimitForecast(
            quantity=goal.quantity,
            unit=goal.unit,
            reach=goal.reach,
            reached_rad_per_s=slow.get(goal.quantity),
            all_shapes=not goal.single,
            decides=goal.quantity not in slow and goal.single and goal.reach is not None and goal.reach < goal.room,
        )
        for goal in goals(known, F, limits)
    ]
    return [*of_goals, *_of_free_run(known.free_run_rad, limits, releases)]


def _too_slow(known: Knowledge, limits: Limits, releases: Sequence[CandidateRelease]) -> dict[str, float]:
    """Return the speed that the joint reaches, rad/s, for each friction limit of a larger speed, by quantity."""
    if not limits.friction:
        return {}
    planned, evidence = reached_speeds(releases, known.model), known.diagnosis.evidence if known.diagnosis else None
    slow: dict[str, float] = {}
    for joint, limit in limits.friction.items():
        recorded = evidence.friction[joint].speed_rad_per_s[-1] if evidence and joint in evidence.friction else 0.0
        if (reached := max(recorded, planned[joint])) < limit.speed_rad_s:
            slow[friction_quantity(joint, limit)] = reached
    return slow


def _of_effects(known: Knowledge, F: Array, limits: Limits) -> Iterator[Goal]:
    sizes = detectable(known, F, NORMAL_Q90, limits.effects)
    for name, amplitudes in limits.effects.items():
        effect = EFFECTS[name]
        several = len(effect.amplitudes) > 1
        reaches = _fitted_together(known, F, name) if several and not effect.shapes else sizes.get(name, {})
        for parameter, limit in amplitudes.items():
            single = not (several and effect.shapes) or name in known.named
            yield Goal(f"{name}.{parameter}", limit.unit, reaches.get(parameter), limit.max / 2, single)


def _fitted_together(known: Knowledge, F: Array, name: str) -> dict[str, float]:
    """Return the half width of the 90 % interval of each amplitude of an effect.

    The result is empty if the amplitudes cannot be separated from each other.
    """
    if not (places := list(known.places.get(name, ()))):
        return {}
    amplitudes = schur_complement(F, [i for i in known.fitted if i not in places], places)
    of_recordings = amplitudes - known.prior[np.ix_(places, places)]
    size = np.diag(of_recordings)
    # rounding leaves a size of either sign, and entries next to it, for an amplitude that the fitted values replace
    if np.any(size <= WORTH.seen * np.diag(F)[places]):
        return {}
    scale = 1 / np.sqrt(size)
    unit = of_recordings * scale[:, None] * scale
    if np.linalg.eigvalsh(unit)[0] < WORTH.seen:
        return {}
    stds = np.sqrt(np.diag(np.linalg.inv(unit))) * scale
    return {known.model.columns[i].name: float(NORMAL_Q90 * std) for i, std in zip(places, stds, strict=True)}


def _of_friction(known: Knowledge, F: Array, limits: Limits) -> Iterator[Goal]:
    """Yield one goal for each friction limit.

    The quantity is the friction torque of a joint at the speeds for which the limit holds. It is estimated with a
    free-form friction curve in the model.
    """
    for name, limit in limits.friction.items():
        joint, model = int(name[-1]), known.model
        curve = known.places.get(f"friction_curve_{name}", ())
        places = list(dict.fromkeys([*known.fitted, *curve]))
        free = [model.columns[i] for i in places]
        _, slope = linear_torque(joint, GRID.up_to(limit.speed_rad_s), model.estimate, free, model.rods.constants)
        H, prior = F[np.ix_(places, places)], known.prior[np.ix_(places, places)]
        basis = curve_basis(H - prior, free, free[len(known.fitted) :])
        slope = slope @ basis
        variance = np.einsum("ui,ij,uj->u", slope, np.linalg.inv(basis.T @ H @ basis), slope)
        reach = NORMAL_Q90 * float(np.sqrt(variance.max())) if curve else None
        yield Goal(friction_quantity(name, limit), limit.unit, reach, limit.max / 2)


def _of_ratios(known: Knowledge, F: Array, limits: Limits) -> Iterator[Goal]:
    if not limits.ratios:
        return
    stds = shown_ratio_std(*_with_common_effects(known, F))
    values = known.diagnosis.stated_ratios if known.diagnosis else {}
    for name, limit in limits.ratios.items():
        lower, upper = limit.bounds
        if lower is not None and upper is not None:
            middle = (lower + upper) / 2
        elif name in values:
            middle = values[name].value
        elif name in RATIOS:
            middle = float(known.model.estimate.ratios[RATIOS.index(name)])
        else:
            middle = np.nan
        room = min(abs(end - middle) for end in (lower, upper) if end is not None)
        reach = NORMAL_Q90 * stds[name] if name in stds and np.isfinite(room) else None
        yield Goal(name, limit.unit, reach, max(float(room), 1e-300))


def _of_free_run(
    errors: Sequence[float], limits: Limits, releases: Sequence[CandidateRelease]
) -> Iterator[LimitForecast]:
    """Yield the forecast of the median free-run error, which depends only on the number of sufficiently long releases.

    Args:
        errors: errors of the recorded runs, rad
        limits: limits that the rig must satisfy
        releases: the releases
    """
    if (limit := limits.free_run) is None:
        return
    reach, contained, unknown = None, True, ""
    if len(errors) < 2:
        unknown = f"unknown until there are two recordings of at least {limit.horizon_s:g} s"
    elif not np.isfinite(errors).all():
        unknown = f"unknown: the simulation of a recording fails before {limit.horizon_s:g} s"
    else:
        further = sum(release.duration_s >= limit.horizon_s for release in releases)
        reach, contained = undecided(errors, limit.max, further)
    yield LimitForecast(
        quantity=free_run_quantity(limit), unit=limit.unit, reach=reach, decides=not contained, unknown=unknown
    )


def _with_common_effects(known: Knowledge, F: Array) -> tuple[Knowledge, Array]:
    """Add the common effects to the model, as the intervals of `accept` do.

    The prior of each amplitude has the mean zero and its minimum detectable size as standard deviation.
    """
    names = {name for name in known.places if EFFECTS[name].common} - known.named
    places, wider = [i for name in sorted(names) for i in known.places[name]], F.copy()
    wider[places, places] += np.diag(schur_complement(F, known.fitted, places)) / SIGMAS**2
    return replace(known, named=known.named | names), wider
