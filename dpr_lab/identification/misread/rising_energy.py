"""Find a hand, a drive or a second swing in a table by the energy of its rods, which friction only decreases."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.identification.misread.balance import ENERGY, balance_terms, fit_balance, periods
from dpr_lab.identification.misread.local_motion import local_motion
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class RiseSettings:
    """Limits above which a rise of the energy shows another force."""

    share: float = 0.1
    """Minimum rise of the energy, relative to the exchanged potential energy, that only another force can cause.

    The rise is at most 0.015 in 10 free swings of real rigs, and 0.05 to 0.14 if a hand lets go with a push.
    """
    ratio: float = 4.0
    """Minimum ratio of a rise to the largest rise before or after it.

    Noise, a wrong zero or a wrong unit causes similar rises in each period.
    """
    most: int = 2
    """Maximum number of rises that are compared with the remaining ones.

    In the recording of another rig, three rises may exceed all others.
    """
    apart: float = 2.0
    """Minimum duration of a swing between two rises, in periods of the slower small oscillation."""
    instants: int = 6000
    """Maximum number of instants at which the energy is computed to find its rise."""


RISE = RiseSettings()


@dataclass(frozen=True, slots=True)
class EnergyRise:
    """Rise of the energy of free rods, which a hand, a drive or wrong readings cause."""

    share: float
    """Rise relative to the exchanged potential energy."""
    begin: float
    end: float
    """Instants between which the energy rises, s."""


def energy_rises(t: Array, rods: Array, rig: Rig) -> list[EnergyRise]:
    """Find the rises of the energy of a free swing, which friction only decreases.

    The rises are in order of time, with a swing between them. Further rises are distinguished while a rise above the
    limit remains. The inertias are those of the rig file, or those that conserve the energy best between the rises. The
    velocities are computed with short and with long windows. The result with the smallest remaining rises is used.

    Args:
        t: (n,) times, s
        rods: (n, 2) absolute angles, rad
        rig: the recorded rig
    """
    slow, fast = periods(rig)
    shortest = RISE.apart * slow
    windows = [replace(w, looked_at=len(t), instants=RISE.instants) for w in (ENERGY.motion, ENERGY.smooth)]
    motions = [moving for settings in windows if (moving := local_motion(t, rods, fast, settings)) is not None]
    largest: list[EnergyRise] = []
    for most in range(1, RISE.most + 1):
        candidates: list[tuple[float, list[EnergyRise]]] = []
        for moving in motions:
            terms, inertias = balance_terms(moving, None, rig), np.ones(3)
            for _ in range(2):
                potential = terms[4] + inertias[2] * terms[6]
                energy = inertias @ [terms[0], terms[1], terms[2]] + potential
                if not (size := np.ptp(potential)) > 0:
                    break
                spans = _rises(moving.t, energy / size, most, shortest)
                parts = _between(spans, len(energy))
                others = max(_rise(energy, *part)[0] for part in parts) / size
                shares = (float(energy[end] - energy[begin]) / size for begin, end in spans)
                begins, ends = moving.t[np.transpose(spans)].tolist()
                rises = list(map(EnergyRise, shares, begins, ends))
                candidates.append((others, rises))
                of_parts = [terms[:, first : last + 1] for first, last in parts]
                about_mean = np.hstack([part - part.mean(axis=1, keepdims=True) for part in of_parts])
                inertias = fit_balance(np.cov(about_mean, bias=True), np.zeros(2))[1][:3]
        others, rises = min(candidates, default=(0.0, []), key=lambda candidate: candidate[0])
        apart = all(later.begin - rise.end >= shortest for rise, later in pairwise(rises))
        if rises and apart and min(rise.share for rise in rises) > max(RISE.share, RISE.ratio * others):
            largest = rises
            if others <= RISE.share:
                break
    return largest


def _rises(t: Array, energy: Array, most: int, shortest: float) -> list[tuple[int, int]]:
    """Return the first and last indices of the `most` largest rises.

    A rise is divided if the energy falls within it for at least `shortest` s.
    """
    spans: list[tuple[int, int]] = []
    for _ in range(most):
        _, begin, end = max(_rise(energy, *part) for part in _between(spans, len(energy)))
        spans = sorted([*spans, *_without_swings(t, energy, begin, end, shortest)])
    return spans


def _without_swings(t: Array, energy: Array, begin: int, end: int, shortest: float) -> list[tuple[int, int]]:
    """Divide a rise at each part of at least `shortest` s in which the energy falls.

    Both remaining rises must reach `RISE.share`.
    """
    _, start, stop = _rise(-energy, begin, end)
    least = min(energy[start] - energy[begin], energy[end] - energy[stop])
    if t[stop] - t[start] < shortest or least < RISE.share:
        return [(begin, end)]
    return [
        *_without_swings(t, energy, begin, start, shortest),
        *_without_swings(t, energy, stop, end, shortest),
    ]


def _between(spans: list[tuple[int, int]], n: int) -> list[tuple[int, int]]:
    """Return the first and last indices of the parts of an array of length n outside the given index ranges."""
    return list(zip([0, *(end for _, end in spans)], [*(begin for begin, _ in spans), n - 1], strict=True))


def _rise(energy: Array, first: int, last: int) -> tuple[float, int, int]:
    """Return the largest rise of an energy between two indices, and the indices at which it begins and ends."""
    part = energy[first : last + 1]
    end = int(np.argmax(part - np.minimum.accumulate(part)))
    begin = int(np.argmin(part[: end + 1]))
    return float(part[end] - part[begin]), first + begin, first + end
