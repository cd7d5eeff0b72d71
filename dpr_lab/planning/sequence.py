"""A sequence of releases, one after another the one that is worth most per minute."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.planning.candidates import SEARCH, minutes, mountings, near, novelty, placements, spread_poses
from dpr_lab.planning.information import Informed, informed
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.worth.objective import Objective
from dpr_lab.rig_tables import AddedMass, Mounting

Array = NDArray[np.float64]

Mounted = tuple[Mounting, AddedMass | None]


@dataclass(frozen=True, slots=True)
class SequenceStep:
    """One release of a sequence."""

    release: CandidateRelease
    information: Array
    """(k, k) Fisher information that it adds."""
    horizon_s: float
    """Predictability horizon of the planned swing."""
    minutes: float
    """What it costs after the one before."""
    worth: float
    """Weighed bits that it adds."""
    price: float
    """Minutes that its worth is divided by: all of them within a budget, those of the operator's hands without one."""
    simulated: float | None = None
    """Delta D^2 of the most open pair by simulation over that by linearisation; None where nothing is open."""


@dataclass(frozen=True, slots=True)
class SequenceSoFar:
    """What there is before the next release of a sequence."""

    information: Array
    """(k, k) of prior, runs and the releases chosen so far."""
    made: tuple[CandidateRelease, ...]
    """Runs and the releases chosen so far."""
    mounted: Mounted
    """What hangs on the rig."""
    left: float
    """Minutes that are left."""

    def after(self, step: SequenceStep) -> "SequenceSoFar":
        """After a release."""
        return SequenceSoFar(
            self.information + step.information,
            (*self.made, step.release),
            _mounted(step.release),
            self.left - step.minutes,
        )


@dataclass(frozen=True, slots=True)
class Planner:
    """Searches for the next release."""

    objective: Objective
    limits: PlanLimits
    rng: np.random.Generator
    signals: Sequence[CandidateRelease] = ()
    """Driven releases to choose from as well."""

    def sequence(self, count: int, budget_min: float | None) -> list[SequenceStep]:
        """Releases, each the best after those before it.

        Args:
            count: how many, at most
            budget_min: within so many minutes; None: no limit
        """
        known = self.objective.known
        pool, steps = self._pool(), list[SequenceStep]()
        mounted: Mounted = (known.rig.rods.mounting, known.rig.added_mass)
        now = SequenceSoFar(known.information, known.made, mounted, np.inf if budget_min is None else budget_min)
        for _ in range(count):
            chosen = self._best(pool, now)
            if chosen is None:
                break
            pool.append(Informed(chosen.release, chosen.information * known.inflation, chosen.horizon_s))
            steps.append(chosen)
            now = now.after(chosen)
        return steps

    def _pool(self) -> list[Informed]:
        times = self.limits.recording
        duration = min(max(SEARCH.screened_s, times.shortest_s), times.longest_s)
        poses = spread_poses(self.limits, SEARCH.spread, self.rng).tolist()
        rig = self.objective.known.rig
        now, *others = mountings(rig, self.limits)
        releases = [CandidateRelease(a, b, duration, now[0], now[1]) for a, b in poses]
        for k, (mounting, mass) in enumerate(others):
            some = poses[k % 2 :: 2] if len(others) < SEARCH.best else poses[k % SEARCH.best :: SEARCH.best]
            releases += [CandidateRelease(a, b, duration, mounting, mass) for a, b in some]
        return self._informed([*releases, *self.signals])

    def _informed(self, releases: Sequence[CandidateRelease], durations: Sequence[float] = ()) -> list[Informed]:
        return informed([_bent(one) for one in releases], self.objective.known.model, durations)

    def _best(self, pool: list[Informed], now: SequenceSoFar) -> SequenceStep | None:
        """The best of the pool, refined; None where nothing fits the time that is left."""
        ranked = self._ranked(pool, now)
        if not ranked:
            return None
        for width in (SEARCH.near_rad, SEARCH.near_rad / 2):
            free = [one for one in ranked[: SEARCH.best] if one.release.torques is None]
            tried = [
                other for one in free for other in near(one.release, self.limits, width, SEARCH.neighbours, self.rng)
            ]
            refined = self._informed(tried)
            pool += refined
            ranked = sorted([*ranked, *self._ranked(refined, now)], key=_rate, reverse=True)
        return max((self._final(one, now) for one in ranked[: SEARCH.finalists]), key=_rate)

    def _final(self, step: SequenceStep, now: SequenceSoFar) -> SequenceStep:
        """The release at its best duration, its worth as simulation confirms it."""
        averaged = self._averaged(step, now)
        share = self.objective.simulated(averaged.release, averaged.information)
        return averaged if share is None else replace(averaged, worth=averaged.worth * min(share, 1.0), simulated=share)

    def _ranked(self, pool: Sequence[Informed], now: SequenceSoFar) -> list[SequenceStep]:
        """The releases that fit the time left, the best first."""
        F, f = now.information, self.objective.known.inflation
        before = self.objective.worth(F)
        steps = [
            SequenceStep(
                one.release,
                one.information / f,
                one.horizon_s,
                cost,
                novelty(one.release, now.made) * (self.objective.worth(F + one.information / f) - before),
                _price(cost, one.release, now.left),
            )
            for one in pool
            if (cost := minutes(one.release, now.mounted, self.limits)) <= now.left
        ]
        return sorted(steps, key=_rate, reverse=True)

    def _averaged(self, step: SequenceStep, now: SequenceSoFar) -> SequenceStep:
        """The release at its best duration, what it shows averaged over starts as a hand leaves them."""
        release, times = step.release, self.limits.recording
        if release.torques is not None:
            return step
        std = self.objective.known.model.placement_rad
        longest = replace(release, duration_s=times.longest_s)
        durations = [d for d in (SEARCH.screened_s, times.shortest_s) if d < times.longest_s]
        rated = self._informed([longest, *placements(longest, std, SEARCH.placements, self.rng)], durations)
        each = len(rated) // (1 + SEARCH.placements)
        averaged = [
            Informed(rated[k].release, np.mean([one.information for one in rated[k::each]], axis=0), rated[k].horizon_s)
            for k in range(each)
        ]
        return next(iter(self._ranked(averaged, now)), step)


def _mounted(release: CandidateRelease) -> Mounted:
    return release.mounting, release.added


def _bent(release: CandidateRelease) -> CandidateRelease:
    """A rod alone follows its own angle."""
    return replace(release, theta2=release.theta1) if release.setup.alone else release


def _rate(step: SequenceStep) -> float:
    return step.worth / step.price


def _price(cost: float, release: CandidateRelease, left: float) -> float:
    return max(cost if np.isfinite(left) else cost - release.duration_s / 60, 1 / 60)
