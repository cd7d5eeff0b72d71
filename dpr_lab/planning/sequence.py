"""Greedy choice of releases with the largest value per minute.

The value of a release depends on the previous ones.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.planning.candidates import (
    SEARCH,
    bent,
    cheapest_minutes,
    longest_s,
    minutes,
    mounted_now,
    mountings,
    near,
    novelty,
    placements,
    spread_poses,
)
from dpr_lab.planning.information import Informed, informed
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import CandidateRelease, MountedParts
from dpr_lab.planning.worth.objective import Objective


@dataclass(frozen=True, slots=True)
class SequenceStep:
    """One release of a sequence."""

    release: CandidateRelease
    information: Array
    """(k, k) Fisher information of this release."""
    minutes: float
    """Time that the release takes after the previous one, minutes."""
    rate: float
    """Value of the release (weighted sum of the bits that it adds) per minute.

    If there is a budget, this is the whole time of the release, otherwise only the time of the operator.
    """


@dataclass(frozen=True, slots=True)
class SequenceSoFar:
    """State of a sequence before its next release."""

    information: Array
    """(k, k) information of the prior, the runs and the releases chosen so far."""
    made: tuple[CandidateRelease, ...]
    """The runs recorded so far, followed by the releases chosen so far."""
    mounted: MountedParts
    """Mounting before the next release."""
    left: float
    """Remaining time, minutes."""

    def after(self, step: SequenceStep) -> "SequenceSoFar":
        """Return the state of the sequence after a further release."""
        return SequenceSoFar(
            self.information + step.information,
            (*self.made, step.release),
            step.release.mounted,
            self.left - step.minutes,
        )


@dataclass(frozen=True, slots=True)
class Planner:
    """Search for the sequence of releases in a plan."""

    objective: Objective
    limits: PlanLimits
    rng: np.random.Generator
    signals: Sequence[CandidateRelease] = ()
    """Candidate releases with input signals of drives."""

    def sequence(self, count: int, budget_min: float | None) -> list[SequenceStep]:
        """Choose a sequence of releases, each the best one after the previous ones.

        Args:
            count: maximum number of releases
            budget_min: time at the rig, minutes; None: no limit
        """
        known = self.objective.known
        remaining_min = np.inf if budget_min is None else budget_min
        pool, steps = self._pool(remaining_min), list[SequenceStep]()
        now = SequenceSoFar(known.information, known.made, mounted_now(known.rig), remaining_min)
        for _ in range(count):
            chosen = self._best(pool, now)
            if chosen is None:
                return self._longer(steps, now.left)
            pool.append(Informed(chosen.release, chosen.information * known.inflation))
            steps.append(chosen)
            now = now.after(chosen)
        return steps

    def _longer(self, steps: Sequence[SequenceStep], left: float) -> list[SequenceStep]:
        """Extend the releases by the remaining time if it is too short for a further release.

        The last releases are extended first. A longer recording does not require placing the rods again, and it makes
        the ratios more accurate.
        """
        extended = list(steps)
        for k in reversed(range(len(steps))):
            release, cost = steps[k].release, steps[k].minutes
            longest = longest_s(self.limits, alone=k == 0 and not self.objective.known.made)
            duration = min(release.duration_s + np.floor(60 * left + 1e-6), longest)
            if duration > release.duration_s and release.torques is None:
                (informed_longer,) = self._informed([replace(release, duration_s=duration)])
                extended[k] = replace(
                    steps[k],
                    release=informed_longer.release,
                    information=informed_longer.information / self.objective.known.inflation,
                    minutes=cost + (duration - release.duration_s) / 60,
                )
                left -= extended[k].minutes - cost
        return extended

    def _pool(self, budget_min: float) -> list[Informed]:
        times = self.limits.recording
        duration = min(max(SEARCH.screened_s, times.shortest_s), times.longest_s)
        cheapest = cheapest_minutes(self.objective.known.rig, self.limits)
        if cheapest + (duration - times.shortest_s) / 60 > budget_min:
            duration = times.shortest_s
        poses = spread_poses(self.limits, SEARCH.spread, self.rng).tolist()
        parts = list(mountings(self.objective.known.rig, self.limits))
        releases = list[CandidateRelease]()
        for k, mounting in enumerate(parts):
            stride = 1 if k == 0 else min(len(parts), SEARCH.best)
            releases += [_swing(a, b, duration, mounting) for a, b in poses[k % stride :: stride]]
        return self._informed([*releases, *self.signals])

    def _informed(self, releases: Sequence[CandidateRelease], durations: Sequence[float] = ()) -> list[Informed]:
        return informed([bent(release) for release in releases], self.objective.known.model, durations)

    def _best(self, pool: list[Informed], now: SequenceSoFar) -> SequenceStep | None:
        """Return the best release of all candidates after refinement.

        The result is None if no release fits into the remaining time.
        """
        ranked = self._ranked(pool, now)
        if not ranked:
            return None
        for width in (SEARCH.near_rad, SEARCH.near_rad / 2):
            free = [step for step in ranked[: SEARCH.best] if step.release.torques is None]
            tried = [
                other for step in free for other in near(step.release, self.limits, width, SEARCH.neighbours, self.rng)
            ]
            refined = self._informed(tried)
            pool += refined
            ranked = _by_rate([*ranked, *self._ranked(refined, now)])
        return _by_rate(self._averaged(step, now) for step in ranked[: SEARCH.finalists])[0]

    def _ranked(self, pool: Sequence[Informed], now: SequenceSoFar) -> list[SequenceStep]:
        """Return the releases that fit into the remaining time, by decreasing value per minute."""
        costs = [minutes(candidate.release, now.mounted, self.limits) for candidate in pool]
        affordable = [(candidate, cost) for candidate, cost in zip(pool, costs, strict=True) if cost <= now.left]
        if not affordable:
            return []
        F = np.stack([candidate.information for candidate, _ in affordable]) / self.objective.known.inflation
        free = np.isinf(now.left) / 60  # minutes per second of recording that do not count
        worth = self.objective.gain(now.information + F).weighed - self.objective.gain(now.information).weighed
        return _by_rate(
            SequenceStep(
                candidate.release,
                information,
                cost,
                novelty(candidate.release, now.made) * bits / max(cost - free * candidate.release.duration_s, 1 / 60),
            )
            for (candidate, cost), information, bits in zip(affordable, F, worth.tolist(), strict=True)
        )

    def _averaged(self, step: SequenceStep, now: SequenceSoFar) -> SequenceStep:
        """Set the best duration of a release, and average its information over placement errors."""
        release, times = step.release, self.limits.recording
        if release.torques is not None:
            return step
        std = self.objective.known.model.placement_rad
        longest = replace(release, duration_s=longest_s(self.limits, alone=not now.made))
        shorter = {max(SEARCH.screened_s, times.shortest_s), times.shortest_s}
        durations = [d for d in sorted(shorter) if d < longest.duration_s]
        rated = self._informed([longest, *placements(longest, std, SEARCH.placements, self.rng)], durations)
        count = len(rated) // (1 + SEARCH.placements)
        averaged = [
            Informed(rated[k].release, np.mean([placed.information for placed in rated[k::count]], axis=0))
            for k in range(count)
        ]
        return next(iter(self._ranked(averaged, now)), step)


def _swing(theta1: float, theta2: float, duration_s: float, on: MountedParts) -> CandidateRelease:
    """Create a free swing from a start pose; `on` states the mounted parts."""
    return CandidateRelease(theta1, theta2, duration_s, on.mounting, on.added, arm="held" if on.arm_held else "free")


def _by_rate(steps: Iterable[SequenceStep]) -> list[SequenceStep]:
    """Sort steps by decreasing value per minute."""
    return sorted(steps, key=lambda step: -step.rate)
