"""Simulated recordings of possible releases, and the difference between two effects in each of them."""

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
from dpr_lab.gap.screen.record import RATE_HZ, THINNING
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig_tables import AddedMass


@dataclass(frozen=True, slots=True)
class PossibleRelease:
    """A release that an operator could record."""

    text: str
    theta: tuple[float, float]
    """Absolute angles from which the rods are released at rest, rad."""
    duration: float
    added: AddedMass | None = None


MENU = (
    PossibleRelease(
        "a release 5 degrees from hanging, for 30 s until the rods rest", (np.pi - 0.09, np.pi - 0.09), 30.0
    ),
    PossibleRelease("a release with both rods horizontal", (np.pi / 2, np.pi / 2), 10.0),
    PossibleRelease("a release with both rods horizontal on the other side", (1.5 * np.pi, 1.5 * np.pi), 10.0),
    PossibleRelease("a release from near upright", (0.1, 0.1), 10.0),
    PossibleRelease(
        "a release with both rods horizontal and 100 g clamped to the outer rod 0.2 m from its pivot",
        (np.pi / 2, np.pi / 2),
        10.0,
        AddedMass(rod="outer", mass=0.1, position=0.2),
    ),
)


@dataclass(frozen=True, slots=True)
class ExpectedRecording:
    """Predicted changes of the readings of one release by some effects."""

    release: PossibleRelease
    known: Array
    """(n, k) whitened changes of the readings by the parameters that are always fitted."""
    changes: dict[str, Array]
    """(n, p) whitened changes of the readings by the parameters of an effect, by effect."""
    sizes: dict[str, Array]
    """(p,) values of the parameters, by effect: fitted, or typical if the effect is not in the model."""
    compensation: dict[str, Array]
    """(segments, 4, p) change of the initial states that compensates a change of the parameters, by effect."""
    problem: Problem
    """Problem of the simulated release."""
    estimate: Estimate
    """Estimate with which the release is simulated."""
    always_free: Sequence[FreeParameter]
    """Parameters that are always fitted."""
    free: dict[str, list[FreeParameter]]
    """Parameters of each effect."""

    def apart(self, name: str, other: str) -> float:
        """Return the distance of the change by effect `name` from its best fit by effect `other`.

        The distance is in standard deviations of the noise.
        """
        signal = self.changes[name] @ self.sizes[name]
        explained = ColumnSpace.of(np.hstack([self.known, self.changes[other]]), signal).gain()
        return float(np.sqrt(max(signal @ signal - explained, 0.0)))

    def apart_after_fit(self, name: str, other: str) -> float:
        """Simulate readings with effect `name`, fit effect `other`, and return the remaining distance.

        The distance is in standard deviations of the noise. Unlike `apart`, it does not depend on the derivatives at
        the estimate, which are inaccurate near the reversals of a law with memory.
        """
        parameters = [*self.free[name], *self.free[other]]
        present = np.array([parameter.read(self.estimate) for parameter in parameters])
        absent = np.zeros(len(self.sizes[other]))
        signal = self.changes[name] @ self.sizes[name]
        columns = np.hstack([self.known, self.changes[other]])
        imitation = np.asarray(np.linalg.lstsq(columns, signal)[0][-len(absent) :], dtype=np.float64)
        initial = self.compensation[other] @ imitation - self.compensation[name] @ self.sizes[name]
        with_name, with_other = (
            moved(self.estimate, parameters, np.concatenate(values) - present, initial_step)
            for values, initial_step in (
                ((self.sizes[name], absent), np.zeros(initial.shape)),
                ((0.0 * self.sizes[name], imitation), initial),
            )
        )
        readings = replace(self.problem, measured=self.problem.predict(with_name))
        return float(np.sqrt(fit(readings, with_other, [*self.always_free, *self.free[other]]).chi2))


def expected_recordings(recordings: Recordings, chosen: Hypothesis, names: Sequence[str]) -> list[ExpectedRecording]:
    """Predict the changes of the readings by some effects, for each release of the menu.

    Args:
        recordings: recordings that define the noise and the setup of the releases
        chosen: the selected model
        names: the effects
    """
    return [_expected(recordings, chosen, release, names) for release in MENU]


def _expected(
    recordings: Recordings, chosen: Hypothesis, choice: PossibleRelease, names: Sequence[str]
) -> ExpectedRecording:
    estimate = chosen.estimate
    trial, initial = simulated_release(recordings, chosen, choice)
    always_free = [p for p in chosen.fit.free if p.block == "ratios" or p.effect in trial.always]
    parameters = {name: [*effect_parameters(EFFECTS[name])] for name in names}
    known = [*always_free, *trial.all_free(())]
    at_release = trial.with_zeros(estimate.changed(initial=initial))
    linear = linearise(
        trial,
        at_release,
        [*known, *(p for of_effect in parameters.values() for p in of_effect)],
    )
    A, _ = linear.flat
    compensation = -np.linalg.pinv(linear.R, rcond=1e-9) @ linear.initial_state_coefficients
    ends = np.cumsum([len(known), *map(len, parameters.values())])
    columns = {name: slice(i, j) for name, i, j in zip(parameters, ends[:-1], ends[1:], strict=True)}
    fitted = {
        name: np.array([parameter.read(estimate) for parameter in of_effect]) for name, of_effect in parameters.items()
    }
    return ExpectedRecording(
        choice,
        A[:, : ends[0]],
        {name: A[:, of_effect] for name, of_effect in columns.items()},
        {
            name: sizes if sizes.any() else np.array([parameter.size for parameter in parameters[name]])
            for name, sizes in fitted.items()
        },
        {name: compensation[..., of_effect] for name, of_effect in columns.items()},
        replace(trial, prior=None),
        at_release,
        always_free,
        parameters,
    )


def simulated_release(recordings: Recordings, chosen: Hypothesis, choice: PossibleRelease) -> tuple[Problem, Array]:
    """Simulate a release with the fitted estimate, without noise.

    The readings are weighted by the noise level of the recordings.

    Returns:
        the problem with the simulated readings, and the initial state
    """
    t = THINNING.after_release_s + np.arange(int(choice.duration * RATE_HZ)) / RATE_HZ
    estimate, like = chosen.estimate, min(recordings.records, key=lambda recorded: recorded.setup.alone)
    start = np.array([[*choice.theta, 0.0, 0.0]])
    setup = replace(like.run.setup, added=choice.added)
    angles = predict(estimate.whole, estimate.params, recordings.constants, segments([t], setups=[setup]), start)
    sigma = np.tile(np.median(like.sigma, axis=0), (len(t), 1))
    run = replace(like.run, added_mass=choice.added)
    record = replace(like, run=run, setup=setup, t=t, joints=angles, sigma=sigma, breaks=np.zeros(0))
    problem, initial = recordings.only([record]).cut(recordings.working_length)
    initial[0] = start[0]  # the release has its own initial state, not that of the recording
    return problem, initial
