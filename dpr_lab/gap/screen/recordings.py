"""Screened recordings of one rig, and the fitting problem of their segments."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.cut import cut
from dpr_lab.fitting.disturbance import disturbance
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.prior import Prior, prior_of
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.gap.screen.record import Record
from dpr_lab.rig import MASSES, Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SegmentLengths:
    """Segment lengths of the fits, s."""

    first: float = 0.25
    """Length at which the fit converges from any rig file within 20 % of the truth."""
    working: float = 0.5
    """Length at which effects are distinguished: four to seven times as sensitive as the first, and Gauss-Newton still
    converges."""
    steady: float = 2.0
    """The same of rods that turn as one, which no chaos limits: what builds up over swings, as friction and a zero
    error do, stands out against what does not repeat;"""
    steady_parts: int = 5
    """but at least so many segments of each recording, which show its scatter."""


LENGTHS = SegmentLengths()


@dataclass(frozen=True, slots=True)
class InitialGuess:
    """Settings of the initial state estimate from neighbouring readings."""

    near_s: float = 0.03
    """Time over which readings are used: a cubic fits any swing in this time."""
    fewest: int = 6
    """Number of readings for a cubic; if they are not within this time, the next ones are used."""
    before: int = 4
    """Number of readings before the first one of a segment that are used in that case."""


GUESS = InitialGuess()


@dataclass(frozen=True, slots=True)
class Recordings:
    """Preprocessed runs of a diagnosis, and their rig."""

    records: tuple[Record, ...]
    rig: Rig
    ratios: Array | None = None
    """(7,) ratios, b and p/b for the response of the rods to torque noise; None until they are known."""
    exact_torques: bool = False
    """Whether known torques are assumed to be exact."""
    torque_noise_Nm: tuple[float, float] = (np.inf, np.inf)
    """Upper limit of the standard deviation of the measured torques of joints 1 and 2, from a fit."""

    @property
    def constants(self) -> RigConstants:
        """Measured constants of the rig."""
        return rig_constants(self.rig)

    @property
    def prior(self) -> Prior:
        """Prior of the ratios and sizes from the rig file."""
        return prior_of(self.rig)

    @property
    def masses_weighed(self) -> bool:
        """Whether all masses are measured, so that load-dependent friction determines the scale of all torques."""
        return all(self.rig.parameters[name].measured is not None for name in MASSES)

    @property
    def working_length(self) -> float:
        """Length of the segments at which effects are distinguished, s."""
        if not all(item.run.setup.held and item.run.setup.arm is None for item in self.records):
            return LENGTHS.working
        shortest = min((float(np.ptp(item.t)) for item in self.records), default=0.0)
        return float(np.clip(shortest / LENGTHS.steady_parts, LENGTHS.working, LENGTHS.steady))

    def cut(self, length: float) -> tuple[Problem, Array]:
        """Segments of approximately one length, s, and (segments, 4) initial states estimated from the readings."""
        records = self.records
        cuts = [cut(item.t, length, item.breaks) for item in records]
        stretches = [(i, s) for i, own in enumerate(cuts) for s in own]
        problem = Problem(
            segments=segments(
                [records[i].t[s] for i, s in stretches],
                [i for i, _ in stretches],
                [item.run.setup for item in records],
                [records[i].step for i, _ in stretches],
            ),
            measured=np.concatenate([records[i].joints[s] for i, s in stretches]),
            weight=np.concatenate([1 / records[i].sigma[s] for i, s in stretches]),
            model=RodsWithEffects(self.constants),
            masses_weighed=self.masses_weighed,
            always=tuple(name for name, effect in EFFECTS.items() if effect.corrects in self.rig.unsure),
            rezeroed=self.rig.encoders.rezeroed,
            prior=self.prior,
            noise_correlation=float(np.mean([item.noise_correlation for item in records])),
        )
        relative2 = self.rig.encoders.joint2 == "relative"
        initial = np.concatenate(
            [_initial_states(item, own, relative2) for item, own in zip(records, cuts, strict=True)]
        )
        if self.ratios is not None:
            at = Estimate.of(self.ratios, effect_params({}), initial)
            problem = replace(problem, disturbance=disturbance(problem, at, most_Nm=self.torque_noise_Nm))
        return problem, initial

    def without(self, problem: Problem, off: NDArray[np.bool_]) -> "Recordings":
        """Recordings without some readings (samples, 2): faults that are only detectable with a model."""
        if not off.any():
            return self
        run = problem.segments.run[problem.owner]
        return replace(
            self,
            records=tuple(item.without(problem.t[run == i], off[run == i]) for i, item in enumerate(self.records)),
        )

    def only(self, chosen: Sequence[Record]) -> "Recordings":
        """Copy with other runs of the same rig."""
        return replace(self, records=tuple(chosen))


def _initial_states(item: Record, stretches: Sequence[slice], relative2: bool, guess: InitialGuess = GUESS) -> Array:
    """(segments, 4) initial states of the segments, by cubics through the readings; at rest after a release.

    Returns:
        theta1, theta2, omega1, omega2, rad and rad/s
    """
    begins = np.array([segment_start(float(item.t[s.start])) for s in stretches])
    near = [_near(item, s.start, at, guess) for s, at in zip(stretches, begins, strict=True)]
    found = np.empty((len(stretches), 4))
    sizes = np.array([len(window) for window in near])
    for size in np.unique(sizes):
        alike = np.flatnonzero(sizes == size)
        windows = np.array([near[i] for i in alike])
        since = item.t[windows] - begins[alike, None]
        reach = np.abs(since).max(axis=1)
        powers = (since / reach[:, None])[:, :, None] ** np.arange(4)
        across = powers.transpose(0, 2, 1)
        cubic = np.linalg.solve(across @ powers, across @ item.joints[windows])
        found[alike, :2], found[alike, 2:] = cubic[:, 0], cubic[:, 1] / reach[:, None]
    found[:, [1, 3]] += float(relative2) * found[:, [0, 2]]
    if len(item.run.rest):
        found[begins == 0.0] = np.append(item.run.rest[:, 1:].mean(axis=0), [0.0, 0.0])
    return found


def _near(item: Record, start: int, at: float, guess: InitialGuess) -> NDArray[np.int64]:
    """Readings near an instant, on the same side of breaks; or those near the first of its segment if there are few."""
    first, last = np.searchsorted(item.t, _between(item.breaks, float(item.t[start]))).tolist()
    i = max(first, int(np.searchsorted(item.t, at - guess.near_s, side="right")))
    j = min(last, int(np.searchsorted(item.t, at + guess.near_s)))
    if j - i < guess.fewest:
        i, j = max(first, start - guess.before), min(last, start + guess.fewest)
    return np.arange(i, j)


def _between(breaks: Array, t: float) -> tuple[float, float]:
    """The breaks before and after an instant."""
    after = int(np.searchsorted(breaks, t, side="right"))
    edges = [-np.inf, *breaks.tolist(), np.inf]
    return edges[after], edges[after + 1]
