"""Objectives of the search: errors between simulated swings and runs.

The objective `segments` simulates at most ten segments of 0.25 s per run, each from its smoothed state. In such short
segments, chaos does not make the objective erratic. The objective `paper` is equation (2) of docs/theory.md. It
compares the angles and speeds of one free run over the whole recording.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.dynamics.base import base_of_run, rows, whole_parameters
from dpr_lab.dynamics.segments import Segments, segments
from dpr_lab.fitting.cut import partition
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.search.problem import Objective

if TYPE_CHECKING:
    from dpr_lab.identification.preprocess import PreprocessedRun


@dataclass(frozen=True, slots=True)
class ObjectiveSettings:
    """Sampling settings of the objectives."""

    step: float = 0.005
    """Runge-Kutta step and sample spacing of the published search, s.

    A smaller step is not needed to find the basin.
    """
    segment_s: float = 0.25
    """Length of a segment, s; at this length chaos has no influence."""
    segments: int = 10
    """Maximum number of segments per run, distributed over the run.

    This number is sufficient to find the basin; the local solver uses all segments.
    """


SETTINGS = ObjectiveSettings()


Swings = tuple[Segments, Array, Array, Array | None, int]
"""Segments, initial states, target angles [and speeds], whitening of the angles, and divisor of the squared error."""


@dataclass(frozen=True, slots=True)
class ObjectiveChoice:
    """An objective and its search settings."""

    swings: "Callable[[PreprocessedRun, bool], Swings]"
    """Function of a run, and of whether its elbow is clamped, that returns the data of the simulation."""
    settings: str
    """Name of the built-in search file of the objective."""
    words: str
    """Description of the objective for reports."""

    def build(self, runs: "Sequence[PreprocessedRun]", rig: Rig) -> Objective:
        """Return the objective: a function of candidates (n, 9) whose result is the errors (n, runs).

        Args:
            runs: runs with states and noise
            rig: L1, gravity and nominal values
        """
        from dpr_lab.dynamics.rollout import segment_errors  # compiled, slow to import

        parts = [(prepared.run, self.swings(_seen_as_one(prepared, rig), prepared.run.setup.held)) for prepared in runs]

        def errors(candidates: Array) -> Array:
            columns = [
                segment_errors(_rows(candidates, run, rig), swings, initial, targets, whitening).sum(axis=1) / divisor
                for run, (swings, initial, targets, whitening, divisor) in parts
            ]
            return np.stack(columns, axis=1)

        return errors


def _short_segments(prepared: "PreprocessedRun", held: bool) -> Swings:
    """Return short segments that start from smoothed states.

    The objective is the mean squared whitened error of the angles, which is about 1 if only noise remains.
    """
    samples = _thinned(prepared.run.t)
    edges = np.searchsorted(samples, [part.start for part in partition(prepared.run, SETTINGS.segment_s)])
    groups = [group for group in np.split(samples, edges[1:]) if len(group) > 1]
    groups = groups[:: -(-len(groups) // SETTINGS.segments)]
    targets = prepared.run.theta[np.concatenate(groups), 1:]
    return (
        segments([prepared.run.t[group] for group in groups], step=SETTINGS.step),
        prepared.states[[group[0] for group in groups]],
        targets,
        np.diag(1 / prepared.noise.std_joint) if held else prepared.noise.whitening,
        targets.size,
    )


def _whole_run(prepared: "PreprocessedRun", held: bool) -> Swings:
    """Return the free run from the smoothed first state.

    The objective is the cost E(Z) of the publication, docs/theory.md, equation (2). It compares angles and speeds.
    """
    samples = _thinned(prepared.run.t)
    targets = np.hstack([prepared.run.theta[samples, 1:], prepared.states[samples, 2:]])
    return segments([prepared.run.t[samples]], step=SETTINGS.step), prepared.states[:1], targets, None, 1


OBJECTIVES = {
    "segments": ObjectiveChoice(_short_segments, "segments", "short segments, insensitive to chaos"),
    "paper": ObjectiveChoice(_whole_run, "paper", "published E(Z) of whole runs"),
}
"""Objectives by their names for the option `--objective`."""


def objective_words(name: str) -> str:
    """Describe an objective, for example `short segments, insensitive to chaos [segments]`.

    An unknown name is returned unchanged.
    """
    return f"{OBJECTIVES[name].words} [{name}]" if name in OBJECTIVES else name


def _thinned(t: Array) -> Integers:
    """Return indices of samples at intervals of about one step.

    More samples take time without improving a search.
    """
    ticks = np.floor((t - t[0]) / SETTINGS.step + 1e-6)
    return np.flatnonzero(np.diff(ticks, prepend=-1.0) > 0)


def _rows(candidates: Array, run: Run, rig: Rig) -> Array:
    """Convert the candidates to rows of the kernel, for the mounting of a run."""
    L1, g = rig.L1, rig.g
    bases = base_of_run(whole_parameters(candidates, L1, g), run.setup, L1, g)
    return rows(_as_one(bases, run.elbow, L1, g)[0] if run.setup.held else bases, L1, g)


def _as_one(bases: Array, elbow: float, L1: float, g: float) -> tuple[Array, Array]:
    """Replace two rods with a clamped elbow by one equivalent rod.

    The inertia of this rod is A = a + b + 2 d cos(delta), where delta is the angle of the elbow. Its gravity moment E
    and its phase lead phi follow from E exp(i phi) = e1 + e2 exp(i delta). Its angle is theta1 + phi. The result
    contains the base parameters (n, 6) of this rod and its phase lead (n,), rad. The second rod of the base parameters
    is decoupled: its d, e2 and c2 are zero.
    """
    a, b, d, e1, c1, _ = bases.T
    pull = e1 + d * g / L1 * np.exp(1j * elbow)
    inertia, zeros = a + b + 2 * d * np.cos(elbow), np.zeros_like(a)
    return np.stack([inertia, inertia, zeros, np.abs(pull), c1, zeros], axis=1), np.angle(pull)


def _seen_as_one(prepared: "PreprocessedRun", rig: Rig) -> "PreprocessedRun":
    """Convert a run with a clamped elbow to the swing of one equivalent rod.

    The phase lead of this rod is computed from the rig file. Other runs are returned unchanged.
    """
    if not prepared.run.setup.held:
        return prepared
    bases = base_of_run(whole_parameters(rig.nominal, rig.L1, rig.g), prepared.run.setup, rig.L1, rig.g)
    _, lead = _as_one(bases[None], prepared.run.elbow, rig.L1, rig.g)
    theta, states = prepared.run.theta.copy(), prepared.states.copy()
    theta[:, 1], states[:, 0] = theta[:, 1] + lead, states[:, 0] + lead
    theta[:, 2], states[:, 1], states[:, 3] = np.pi, np.pi, 0.0
    return replace(prepared, run=replace(prepared.run, theta=theta), states=states)
