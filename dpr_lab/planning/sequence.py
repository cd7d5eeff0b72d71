"""Greedy search for a sequence of releases: the next one has the largest value per minute, given the previous ones."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import WHOLE
from dpr_lab.planning.candidates import (
    SEARCH,
    cheapest_minutes,
    longest_s,
    minutes,
    mounted_now,
    mountings,
    near,
    placements,
    spread_poses,
    swinging,
    value,
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
    """Value of the release per minute: weighted sum of the bits that it adds, divided by the time.

    With a budget, the time is that of the whole release; otherwise the duration of the recording does not count.
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
        state = SequenceSoFar(known.information, known.made, mounted_now(known.rig), remaining_min)
        for _ in range(count):
            chosen = self._best(pool, state)
            if chosen is None:
                return self._longer(steps, state.left)
            pool.append(Informed(chosen.release, chosen.information))
            steps.append(chosen)
            state = state.after(chosen)
        return steps

    def _longer(self, steps: Sequence[SequenceStep], left: float) -> list[SequenceStep]:
        """Extend the releases by the remaining time, which is too short for a further release.

        The last releases are extended first. A longer recording makes the ratios more accurate, and the rods need not
        be placed again.
        """
        extended = list(steps)
        for k in reversed(range(len(steps))):
            release = steps[k].release
            longest = longest_s(self.limits, alone=k == 0 and not self.objective.known.made)
            duration = min(release.duration_s + np.floor(60 * left + 1e-6), longest)
            if duration > release.duration_s and release.torques is None:
                (longer,) = informed([replace(release, duration_s=duration)], self.objective.known.model)
                added_min = (duration - release.duration_s) / 60
                extended[k] = SequenceStep(
                    longer.release, longer.information, steps[k].minutes + added_min, steps[k].rate
                )
                left -= added_min
        return extended

    @property
    def _e(self) -> tuple[float, float]:
        """Gravity torques e1 and e2 of the rods in the current model, N m."""
        known = self.objective.known
        of_rig = dict(zip(WHOLE, known.model.estimate.whole.tolist(), strict=True))
        return of_rig["e1"], of_rig["d"] * known.rig.g / known.rig.L1

    def _pool(self, budget_min: float) -> list[Informed]:
        known, times = self.objective.known, self.limits.recording
        duration = min(max(SEARCH.screened_s, times.shortest_s), times.longest_s)
        if cheapest_minutes(known.rig, self.limits) + (duration - times.shortest_s) / 60 > budget_min:
            duration = times.shortest_s
        poses = spread_poses(self.limits, SEARCH.spread, self.rng)
        parts = list(mountings(known.rig, self.limits))
        releases = list[CandidateRelease]()
        for k, (mounting, added, held) in enumerate(parts):
            stride = 1 if k == 0 else min(len(parts), SEARCH.best)
            swing = CandidateRelease(0.0, 0.0, duration, mounting, added, arm="held" if held else "free")
            releases += swing.moved(poses[k % stride :: stride])
        return informed([*swinging(releases, self._e), *self.signals], known.model)

    def _best(self, pool: list[Informed], now: SequenceSoFar) -> SequenceStep | None:
        """Return the best release after a refinement of the best candidates; None if none fits the remaining time.

        The refined candidates are added to `pool`.
        """
        ranked = self._ranked(pool, now)
        if not ranked:
            return None
        for width in (SEARCH.near_rad, SEARCH.near_rad / 2):
            neighbours = [
                other
                for step in ranked[: SEARCH.best]
                if step.release.torques is None
                for other in near(step.release, self.limits, width, SEARCH.neighbours, self.rng, self._e)
            ]
            refined = informed(neighbours, self.objective.known.model)
            pool += refined
            ranked = _by_rate([*ranked, *self._ranked(refined, now)])
        return _by_rate(self._averaged(step, now) for step in ranked[: SEARCH.finalists])[0]

    def _ranked(self, pool: Sequence[Informed], now: SequenceSoFar) -> list[SequenceStep]:
        """Return the releases that fit into the remaining time, by decreasing value per minute."""
        affordable = [
            (candidate, cost)
            for candidate in pool
            if (cost := minutes(candidate.release, now.mounted, self.limits)) <= now.left
        ]
        if not affordable:
            return []
        F = np.stack([candidate.information for candidate, _ in affordable])
        free = np.isinf(now.left) / 60  # minutes per second of recording that do not count
        worth = self.objective.gain(now.information + F).weighed - self.objective.gain(now.information).weighed
        return _by_rate(
            SequenceStep(
                candidate.release,
                information,
                cost,
                value(bits, candidate.release, now.made) / max(cost - free * candidate.release.duration_s, 1 / 60),
            )
            for (candidate, cost), information, bits in zip(affordable, F, worth.tolist(), strict=True)
        )

    def _averaged(self, step: SequenceStep, now: SequenceSoFar) -> SequenceStep:
        """Return the release with its best duration, and with its information averaged over placement errors."""
        release, times = step.release, self.limits.recording
        if release.torques is not None:
            return step
        model = self.objective.known.model
        longest = replace(release, duration_s=longest_s(self.limits, alone=not now.made))
        durations = sorted({max(SEARCH.screened_s, times.shortest_s), times.shortest_s})
        erring = placements(longest, model.placement_rad, SEARCH.placements, self.rng)
        rated = informed([longest, *erring], model, durations)
        count = len(rated) // (1 + SEARCH.placements)
        averaged = [
            Informed(rated[k].release, np.mean([placed.information for placed in rated[k::count]], axis=0))
            for k in range(count)
        ]
        return next(iter(self._ranked(averaged, now)), step)


def _by_rate(steps: Iterable[SequenceStep]) -> list[SequenceStep]:
    """Sort steps by decreasing value per minute."""
    return sorted(steps, key=lambda step: -step.rate)
