"""Simulated recordings of possible releases, and the distance of two effects in each of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.prediction import predict
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.estimate import Estimate, FreeParameter, effect_parameters, moved
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.checks import AdvisedRelease
from dpr_lab.gap.screen.record import RATE_HZ, THINNING
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig_tables import AddedMass


def _release(theta1: float, theta2: float, duration_s: float, added: AddedMass | None = None) -> AdvisedRelease:
    return AdvisedRelease(theta1_rad=theta1, theta2_rad=theta2, duration_s=duration_s, added_mass=added)


MENU = {
    "a release 5 degrees from hanging, for 30 s until the rods rest": _release(np.pi - 0.09, np.pi - 0.09, 30.0),
    "a release with both rods horizontal": _release(np.pi / 2, np.pi / 2, 10.0),
    "a release with both rods horizontal on the other side": _release(1.5 * np.pi, 1.5 * np.pi, 10.0),
    "a release from near upright": _release(0.1, 0.1, 10.0),
    "a release with both rods horizontal and 100 g clamped to the outer rod 0.2 m from its pivot": _release(
        np.pi / 2, np.pi / 2, 10.0, AddedMass(rod="outer", mass=0.1, position=0.2)
    ),
}
"""Releases that an operator could record, by their description."""
MENU_OF_ONE_ROD = {
    text.replace("both rods", "the rod").replace("rods rest", "rod rests"): release
    for text, release in MENU.items()
    if release.added_mass is None
}
"""Releases of a rig with one rod, by their description."""


@dataclass(frozen=True, slots=True)
class _Influence:
    """Influence of one effect on the readings of a release."""

    free: list[FreeParameter]
    """Parameters of the effect."""
    sizes: Array
    """(p,) values of the parameters: fitted, or typical if the effect is not in the model."""
    changes: Array
    """(n, p) whitened changes of the readings by the parameters."""
    compensation: Array
    """(segments, 4, p) change of the initial states that best compensates a change of the parameters."""

    @property
    def signal(self) -> Array:
        """(n,) whitened change of the readings by the effect at these sizes."""
        return self.changes @ self.sizes


@dataclass(frozen=True, slots=True)
class ExpectedRecording:
    """Predicted changes of the readings of one release by some effects."""

    text: str
    """Description of the release."""
    release: AdvisedRelease
    influences: dict[str, _Influence]
    """Influence of each effect."""
    always_free: Sequence[FreeParameter]
    """Parameters that every fit contains, without encoder zeros: the ratios, and effects that are always free."""
    known: Array
    """(n, k) whitened changes of the readings by the parameters that every fit contains, with encoder zeros."""
    problem: Problem
    """Problem of the simulated release."""
    estimate: Estimate
    """Estimate with which the release is simulated."""

    def distance(self, name: str, other: str) -> float:
        """Return the distance between the signature of an effect and its best approximation by another effect.

        The distance is in standard deviations of the noise.
        """
        signal = self.influences[name].signal
        explained = ColumnSpace.of(np.hstack([self.known, self.influences[other].changes]), signal).gain()
        return float(np.sqrt(max(signal @ signal - explained, 0.0)))

    def distance_after_fit(self, name: str, other: str) -> float:
        """Simulate readings with effect `name`, fit effect `other`, and return the remaining distance.

        The distance is in standard deviations of the noise. Unlike `distance`, it does not depend on derivatives at the
        estimate, which are inaccurate near the reversals of a friction law with memory.
        """
        cause, fitted = self.influences[name], self.influences[other]
        parameters = [*cause.free, *fitted.free]
        present = np.array([parameter.read(self.estimate) for parameter in parameters])
        absent = np.zeros(len(fitted.sizes))
        columns = np.hstack([self.known, fitted.changes])
        imitation = np.asarray(np.linalg.lstsq(columns, cause.signal)[0][-len(absent) :], dtype=np.float64)
        initial = fitted.compensation @ imitation - cause.compensation @ cause.sizes
        with_name, with_other = (
            moved(self.estimate, parameters, np.concatenate(values) - present, initial_step)
            for values, initial_step in (
                ((cause.sizes, absent), np.zeros(initial.shape)),
                ((0.0 * cause.sizes, imitation), initial),
            )
        )
        readings = replace(self.problem, measured=self.problem.predict(with_name))
        return float(np.sqrt(fit(readings, with_other, [*self.always_free, *fitted.free]).chi2))


def expected_recordings(recordings: Recordings, chosen: Hypothesis, names: Sequence[str]) -> list[ExpectedRecording]:
    """Predict the changes of the readings by some effects, for each predefined release.

    Args:
        recordings: recordings whose noise and setup the releases have
        chosen: the selected model
        names: the effects
    """
    menu = MENU_OF_ONE_ROD if all(recorded.setup.alone for recorded in recordings.records) else MENU
    length = recordings.rig.L2
    possible = {text: r for text, r in menu.items() if not r.added_mass or not length or r.added_mass.position < length}
    return [_expected(recordings, chosen, text, release, names) for text, release in possible.items()]


def _expected(
    recordings: Recordings, chosen: Hypothesis, text: str, release: AdvisedRelease, names: Sequence[str]
) -> ExpectedRecording:
    trial, initial = simulated_release(recordings, chosen, release)
    always_free = [p for p in chosen.fit.free if p.block == "ratios" or p.effect in trial.always]
    parameters = {name: [*effect_parameters(EFFECTS[name])] for name in names}
    known = [*always_free, *trial.all_free(())]
    estimate = trial.with_zeros(chosen.estimate.changed(initial=initial))
    linear = linearise(trial, estimate, [*known, *(p for of_effect in parameters.values() for p in of_effect)])
    A, _ = linear.flat
    compensation = -np.linalg.pinv(linear.R, rcond=1e-9) @ linear.initial_state_coefficients
    influences, first = dict[str, _Influence](), len(known)
    for name, free in parameters.items():
        fitted = np.array([parameter.read(chosen.estimate) for parameter in free])
        sizes = fitted if fitted.any() else np.array([parameter.size for parameter in free])
        columns = slice(first, first + len(free))
        influences[name] = _Influence(free, sizes, A[:, columns], compensation[..., columns])
        first += len(free)
    problem = replace(trial, prior=None)
    return ExpectedRecording(text, release, influences, always_free, A[:, : len(known)], problem, estimate)


def simulated_release(recordings: Recordings, chosen: Hypothesis, choice: AdvisedRelease) -> tuple[Problem, Array]:
    """Simulate a release with the selected set, without noise; the weights follow from the noise of the recordings.

    Returns:
        the problem with the simulated readings, and the initial states of its segments
    """
    t = THINNING.after_release_s + np.arange(int(choice.duration_s * RATE_HZ)) / RATE_HZ
    estimate, reference = chosen.estimate, min(recordings.records, key=lambda recorded: recorded.setup.alone)
    start = np.array([[choice.theta1_rad, choice.theta2_rad, 0.0, 0.0]])
    setup = replace(reference.run.setup, added=choice.added_mass)
    angles = predict(estimate.whole, estimate.params, recordings.constants, segments([t], setups=[setup]), start)
    sigma = np.tile(np.median(reference.sigma, axis=0), (len(t), 1))
    run = replace(reference.run, added_mass=choice.added_mass)
    record = replace(reference, run=run, setup=setup, t=t, joints=angles, sigma=sigma, breaks=np.zeros(0))
    problem, initial = recordings.only([record]).cut(recordings.working_length)
    initial[0] = start[0]  # the release has its own initial state, not that of the recording
    return problem, initial
