"""Knowledge before the next release: estimate, information, and undecided causes.

The unknowns are the ratios, b and p/b, and the amplitudes of every effect that is detectable in a release. Their
information is that of the prior of the rig file and of the runs recorded so far, F = P^-1 + H / f, where f is the
variance inflation of a reading in these runs. Without runs, the prior alone is used.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.effect import Effect
from dpr_lab.fitting.estimate import ON_ELBOW, UNKNOWN_RATIOS, Estimate, effect_parameters, ratio_parameters
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.prior import STRENGTH, Prior, prior_of
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.gap.bare_model import nominal_ratios
from dpr_lab.gap.result.checks import NONE_OF_THEM
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.record import RATE_HZ, record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.planning.information import PresentModel
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]

RATIO_COLUMNS = len(UNKNOWN_RATIOS)
"""The unknowns begin with the ratios, b and p/b; amplitudes of effects follow."""


@dataclass(frozen=True, slots=True)
class Causes:
    """A named effect and its alternatives."""

    about: str
    """The named effect."""
    probabilities: Mapping[str, float]
    """Probability of each candidate cause, including the named effect."""


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Knowledge of the rig before the next release."""

    rig: Rig
    model: PresentModel
    prior: Array
    """(k, k) information of the rig file."""
    information: Array
    """(k, k) F, the information of prior and runs."""
    inflation: float = 1.0
    """Variance inflation f of a reading, in past and future runs."""
    named: frozenset[str] = frozenset()
    """Effects of the model."""
    causes: tuple[Causes, ...] = ()
    """Candidate causes of each named effect."""
    unexplained: float = 0.0
    """Probability of a cause outside the library."""
    diagnosis: Diagnosis | None = None
    """Diagnosis of the runs recorded so far; None without runs."""
    made: tuple[CandidateRelease, ...] = ()
    """The runs recorded so far, as releases."""
    places: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Effect -> its columns in the vector of unknowns."""

    @property
    def amplitudes(self) -> Array:
        """(k,) amplitudes of the model's effects, in the order of the unknowns; zero elsewhere."""
        values = np.array([column.read(self.model.estimate) for column in self.model.columns])
        values[:RATIO_COLUMNS] = 0.0
        return values

    @property
    def fitted(self) -> list[int]:
        """Columns that every fit estimates: the ratios, b and p/b, and the effects of the model."""
        return [*range(RATIO_COLUMNS), *(i for name in self.named for i in self.places.get(name, ()))]


def known_before(rig: Rig, driven: bool = False) -> Knowledge:
    """Knowledge from the rig file alone.

    Args:
        rig: the rig
        driven: whether drives may act, so that their effects count
    """
    model = _model(rig, nominal_ratios(rig), effect_params({}), _noise_of(rig), driven)
    prior = _prior_information(prior_of(rig), model)
    return Knowledge(rig, model, prior, prior, places=_places(model))


def known_after(runs: Sequence[Run], rig: Rig, diagnosis: Diagnosis, driven: bool = False) -> Knowledge:
    """Knowledge from the rig file, the runs and their diagnosis.

    Args:
        runs: the runs that were diagnosed
        rig: the rig
        diagnosis: diagnosis of these runs
        driven: whether drives may act in the next release
    """
    ratios, params = diagnosis.unknowns, effect_params(diagnosis.model_effects)
    if not np.isfinite(ratios[ON_ELBOW]):
        ratios[ON_ELBOW] = nominal_ratios(rig)[ON_ELBOW]
    recordings = Recordings(tuple(record(run, rig) for run in runs), rig)
    sigma = np.median([np.median(one.sigma, axis=0) for one in recordings.records], axis=0)
    model = _model(rig, ratios, params, sigma / np.sqrt(RATE_HZ), driven or any(r.setup.torques for r in runs))
    prior = _prior_information(prior_of(rig), model)
    inflation = max(1.0, diagnosis.chi2_per_dof)
    return Knowledge(
        rig,
        model,
        prior,
        prior + information_of_runs(recordings, model) / inflation,
        inflation,
        frozenset(diagnosis.model_effects),
        tuple(_causes(diagnosis)),
        diagnosis.probabilities.get(NONE_OF_THEM, 0.0),
        diagnosis,
        tuple(_made(run) for run in runs),
        _places(model),
    )


def _made(run: Run) -> CandidateRelease:
    """Convert a run to a release."""
    _, theta1, theta2 = run.theta[np.searchsorted(run.t, 0.0)].tolist()
    return CandidateRelease(theta1, theta2, run.duration, run.mounting, run.added_mass)


def _model(rig: Rig, ratios: Array, params: Array, noise: Array, driven: bool) -> PresentModel:
    at = Estimate.of(ratios, params, np.zeros((0, 4)))
    library = [effect for effect in EFFECTS.values() if _can_act(effect, driven)]
    columns = (
        *ratio_parameters(at, range(RATIO_COLUMNS)),
        *(parameter for effect in library for parameter in effect_parameters(effect)),
    )
    tolerance = float(np.median([pose.tolerance for pose in rig.poses.values()] or [0.05]))
    rods = RodsWithEffects(rig_constants(rig))
    return PresentModel(at, columns, rods, noise, tolerance / 2, rig.encoders.rezeroed)


def _can_act(effect: Effect, driven: bool) -> bool:
    """Whether an effect can act in a planned release: its arm is clamped, and unique events do not recur."""
    return not (effect.event or effect.absorbed_by or effect.of_arm) and (driven or not effect.driven)


def _noise_of(rig: Rig) -> Array:
    return np.asarray(rig.reading_std[1:] / np.sqrt(rig.link.rate_hz), dtype=np.float64)


def _places(model: PresentModel) -> dict[str, tuple[int, ...]]:
    places: dict[str, tuple[int, ...]] = {}
    for i, column in enumerate(model.columns):
        if column.effect:
            places[column.effect] = (*places.get(column.effect, ()), i)
    return places


def _prior_information(prior: Prior, model: PresentModel) -> Array:
    """(k, k) information of the rig file: ratios, b and p/b, and amplitudes by their limits."""
    information = np.zeros((len(model.columns), len(model.columns)))
    seen = np.isfinite(prior.mean)
    places = np.flatnonzero(seen)
    information[np.ix_(places, places)] = np.linalg.inv(prior.covariance[np.ix_(seen, seen)])
    for i, column in enumerate(model.columns[RATIO_COLUMNS:], RATIO_COLUMNS):
        information[i, i] = 1.0 / min(prior.std(column), STRENGTH.zeros * column.size) ** 2
    return information


def information_of_runs(recordings: Recordings, model: PresentModel) -> Array:
    """(k, k) Fisher information of runs as a diagnosis cuts them."""
    problem, initial = recordings.cut(recordings.working_length)
    at = problem.with_zeros(model.estimate.changed(initial=initial))
    columns = problem.all_free(model.columns)
    A, _ = linearise(problem, at, columns).flat
    H, k = A.T @ A, len(model.columns)
    if len(columns) > k:
        H = H[:k, :k] - H[:k, k:] @ np.linalg.lstsq(H[k:, k:], H[k:, :k], rcond=1e-12)[0]
    return H[:k, :k]


def _causes(diagnosis: Diagnosis) -> Iterator[Causes]:
    """Candidate causes of each named effect: the members of its class by their odds, and its alternatives."""
    for effect in diagnosis.effects:
        odds = {name: effect.odds.get(name, 1 / len(effect.members)) for name in effect.members}
        own = {name: effect.probability * share for name, share in odds.items()}
        others = {rival.name: rival.probability for rival in diagnosis.rivals if rival.instead_of == effect.name}
        yield Causes(effect.name, own | {name: p for name, p in others.items() if name not in own})
