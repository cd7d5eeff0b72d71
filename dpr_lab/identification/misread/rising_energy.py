"""Find a hand, a drive or a second swing in a table by the energy of its rods, which friction only decreases."""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.identification.misread.balance import ENERGY, balance_terms, fit_balance, periods
from dpr_lab.identification.misread.local_motion import local_motion
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class RiseSettings:
    """Limits beyond which a rise of the energy shows another force."""

    share: float = 0.1
    """Minimum rise of the energy, relative to the exchanged potential energy, that only another force can cause. It is
    at most 0.015 in 10 free swings of real rigs, and 0.05 to 0.14 if a hand lets go with a push."""
    ratio: float = 4.0
    """Minimum ratio of this rise to the rises before and after it. Noise, a wrong zero or a wrong unit causes rises in
    each period."""
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


def largest_rise(t: Array, rods: Array, rig: Rig) -> EnergyRise | None:
    """Find a rise of the energy of a free swing, which friction only decreases.

    The inertias are those of the rig file, or those that conserve the energy best before and after the rise. The
    velocities are computed with short and with long windows. The result with the smallest other rises counts.

    Args:
        t: (n,) times, s
        rods: (n, 2) absolute angles, rad
        rig: the recorded rig
    """
    rises: list[tuple[float, EnergyRise]] = []
    for settings in (ENERGY.motion, ENERGY.smooth):
        whole = replace(settings, looked_at=len(t), instants=RISE.instants)
        if (moving := local_motion(t, rods, periods(rig)[1], whole)) is None:
            continue
        terms, inertias = balance_terms(moving, None, rig), np.ones(3)
        for _ in range(2):
            potential = terms[4] + inertias[2] * terms[6]
            energy = inertias @ [terms[0], terms[1], terms[2]] + potential
            if not (size := np.ptp(potential)) > 0:
                break
            share, begin, end = _rise(energy / size)
            parts = terms[:, : begin + 1], terms[:, end:]
            others = max(_rise(energy[: begin + 1])[0], _rise(energy[end:])[0]) / size
            rises.append((others, EnergyRise(share, *moving.t[[begin, end]].tolist())))
            about_mean = np.hstack([part - part.mean(axis=1, keepdims=True) for part in parts])
            inertias = fit_balance(np.cov(about_mean, bias=True), np.zeros(2))[1][:3]
    others, largest = min(rises, default=(0.0, None), key=lambda rise: rise[0])
    large = largest is not None and largest.share > max(RISE.share, RISE.ratio * others)
    return largest if large else None


def _rise(energy: Array) -> tuple[float, int, int]:
    """Return the largest rise of an energy (n,), and the indices at which it begins and ends."""
    end = int(np.argmax(energy - np.minimum.accumulate(energy)))
    begin = int(np.argmin(energy[: end + 1]))
    return float(energy[end] - energy[begin]), begin, end
