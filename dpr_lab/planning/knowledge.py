"""Knowledge of the rig before the next release: estimates, Fisher information, and undecided causes.

The unknowns are the ratios, b and p/b, and the amplitudes of every effect that is detectable in a release. The
information about the unknowns is F = P^-1 + H / f. P is the prior covariance from the rig file, H the normal matrix of
the runs recorded so far, and f the variance inflation of a reading in these runs. If there are no runs, only the prior
contributes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.torque_scale import TORQUE_SCALE_JOINT0
from dpr_lab.fitting.estimate import (
    ON_ELBOW,
    UNKNOWN_RATIOS,
    Estimate,
    FreeParameter,
    effect_parameters,
    ratio_parameters,
)
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.prior import STRENGTH, Prior, prior_of
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.gap.bare_model import nominal_ratios
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.record import RATE_HZ, record
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.identification.moving_arm.unknowns import arm_start
from dpr_lab.planning.acting import GRAVITY_ONLY, Acting
from dpr_lab.planning.information import PresentModel, informed
from dpr_lab.planning.release import ArmState, CandidateRelease
from dpr_lab.planning.stopping import Causes, causes_of
from dpr_lab.rig import Rig
from dpr_lab.run import Run

RATIO_COLUMNS = len(UNKNOWN_RATIOS)
"""Number of unknowns before the amplitudes of effects: the ratios, b and p/b."""


@dataclass(frozen=True, slots=True)
class HeldRatios:
    """Narrow prior that keeps ratios at their nominal values if no release determines them."""

    exactness: float = 1e6
    """Value of a ratio divided by the standard deviation of its prior."""


HELD = HeldRatios()


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Knowledge of the rig before the next release."""

    rig: Rig
    model: PresentModel
    prior: Array
    """(k, k) information of the rig file about the unknowns."""
    information: Array
    """(k, k) F, the information of the prior and the runs about the unknowns."""
    inflation: float = 1.0
    """Variance inflation f of a reading, in recorded and planned runs."""
    named: frozenset[str] = frozenset()
    """Names of the effects in the model."""
    always: frozenset[str] = frozenset()
    """Effects of the model that are not faults: the moving arm, and the gain of its drive if it is unknown."""
    causes: tuple[Causes, ...] = ()
    """Candidate causes of each named effect."""
    diagnosis: Diagnosis | None = None
    """Diagnosis of the runs recorded so far; None if there are no runs."""
    made: tuple[CandidateRelease, ...] = ()
    """The runs recorded so far, converted to releases."""
    places: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Columns of each effect in the vector of unknowns, by the name of the effect."""
    hidden_ratios: tuple[int, ...] = ()
    """Indices of the ratios that no release determines."""

    @property
    def amplitudes(self) -> Array:
        """Amplitudes (k,) of the effects in the model, in the order of the unknowns.

        The values of other unknowns are zero.
        """
        values = np.array([column.read(self.model.estimate) for column in self.model.columns])
        values[:RATIO_COLUMNS] = 0.0
        return values

    @property
    def fitted(self) -> list[int]:
        """Columns of the unknowns of every fit: ratios, b, p/b, and effects of the model."""
        return [*range(RATIO_COLUMNS), *(i for name in self.named for i in self.places.get(name, ()))]


def known_before(rig: Rig, acting: Acting = GRAVITY_ONLY) -> Knowledge:
    """Derive the knowledge from the rig file alone, before any recording.

    Args:
        rig: the rig
        acting: parts that may act in the planned releases; they determine which effects are considered
    """
    model = _model(rig, nominal_ratios(rig), _with_arm({}, rig, acting), _noise_of(rig), acting)
    always = _always(rig, acting)
    prior = _prior_information(prior_of(rig), model, always, acting.hidden_ratios)
    return Knowledge(
        rig, model, prior, prior, named=always, always=always, places=_places(model), hidden_ratios=acting.hidden_ratios
    )


def known_after(runs: Sequence[Run], rig: Rig, diagnosis: Diagnosis, acting: Acting = GRAVITY_ONLY) -> Knowledge:
    """Derive the knowledge from the rig file, the recorded runs and their diagnosis.

    Args:
        runs: the runs that were diagnosed
        rig: the rig
        diagnosis: diagnosis of these runs
        acting: parts that may act in the next release
    """
    recordings = Recordings(tuple(record(run, rig) for run in runs), rig)
    acting = acting.including([recorded.setup for recorded in recordings.records])
    ratios, always = diagnosis.unknowns, _always(rig, acting)
    params = _with_arm(diagnosis.model_effects, rig, acting)
    if not np.isfinite(ratios[ON_ELBOW]):
        ratios[ON_ELBOW] = nominal_ratios(rig)[ON_ELBOW]
    model = _model(rig, ratios, params, _noise_in(recordings), acting)
    prior = _prior_information(prior_of(rig), model, always, acting.hidden_ratios)
    inflation = max(1.0, diagnosis.chi2_per_dof)
    return Knowledge(
        rig,
        model,
        prior,
        prior + information_of_runs(recordings, model) / inflation,
        inflation,
        frozenset(diagnosis.model_effects) | always,
        always,
        tuple(causes_of(diagnosis)),
        diagnosis,
        tuple(_made(run) for run in runs),
        _places(model),
        acting.hidden_ratios,
    )


def _made(run: Run) -> CandidateRelease:
    """Return the release that corresponds to a recorded run."""
    _, theta1, theta2 = run.theta[np.searchsorted(run.t, 0.0)].tolist()
    arm: ArmState = run.arm_mode if run.arm_mode in ("free", "driven") else "held"
    return CandidateRelease(theta1, theta2, run.duration, run.mounting, run.added_mass, arm=arm)


def _always(rig: Rig, acting: Acting) -> frozenset[str]:
    """Return the effects of every model: a moving arm and an unknown gain of its drive."""
    gain = acting.arm_motor and not drive_gain(rig).known
    return frozenset([FREE_ARM.name] * acting.arm_moves + [DRIVE_GAIN.name] * gain)


def _with_arm(effects: Mapping[str, Mapping[str, float]], rig: Rig, acting: Acting) -> Array:
    """Return the (SIZE,) parameters of effects.

    A moving arm without an estimate has the parameters of the rig file.
    """
    inertia, viscous = arm_start(rig)
    arm = {FREE_ARM.name: {"inertia_kgm2": inertia, "viscous_Nms": viscous}} if acting.arm_moves else {}
    return effect_params({**arm, **effects})


def _model(rig: Rig, ratios: Array, params: Array, noise: Array, acting: Acting) -> PresentModel:
    estimate = Estimate.of(ratios, params, np.zeros((0, 4)))
    library = [effect for effect in EFFECTS.values() if _can_act(effect, rig, acting)]
    columns = (
        *ratio_parameters(estimate, range(RATIO_COLUMNS)),
        *(parameter for effect in library for parameter in effect_parameters(effect)),
    )
    tolerance = float(np.median([pose.tolerance for pose in rig.poses.values()] or [0.05]))
    rods = RodsWithEffects(rig_constants(rig))
    model = PresentModel(estimate, columns, rods, noise, tolerance / 2, rig.encoders.rezeroed)
    return model if acting.elbow else _of_one_rod(model, acting)


def _of_one_rod(model: PresentModel, acting: Acting) -> PresentModel:
    """Remove effects that need two rods from the model, if a rod is mounted alone.

    The readings of a single rod do not depend on the amplitudes of these effects.
    """
    swings = [CandidateRelease(2.0, 2.0, LENGTHS.working, mounting) for mounting in acting.rods]
    powers = np.diag(np.sum([swing.information for swing in informed(swings, model)], axis=0))

    visible = {column.effect for column, power in zip(model.columns, powers.tolist(), strict=True) if power > 0}

    def acts(column: FreeParameter) -> bool:
        effect = EFFECTS.get(column.effect)
        return effect is None or effect.name in visible or effect.of_arm or effect.driven

    return replace(model, columns=tuple(filter(acts, model.columns)))


def _can_act(effect: Effect, rig: Rig, acting: Acting) -> bool:
    """Return whether an effect can act in a planned release.

    An event that occurs only once cannot act in a further release.
    """
    if effect.event or effect.absorbed_by or (effect.of_arm and not acting.arm_moves):
        return False
    if effect.joints == (1,) and not acting.elbow:
        return False
    if not effect.driven:
        return True
    if not effect.of_arm:
        return acting.joint_drives or (acting.arm_motor and effect.stage == "input")
    unknown_gain = not drive_gain(rig).known
    return acting.arm_motor and effect is not (TORQUE_SCALE_JOINT0 if unknown_gain else DRIVE_GAIN)


def _noise_of(rig: Rig) -> Array:
    """Return the (3,) noise densities of encoders 1, 2 and 0, rad/sqrt(Hz).

    They follow from the rig file.
    """
    return np.asarray(rig.reading_std[[1, 2, 0]] / np.sqrt(rig.link.rate_hz), dtype=np.float64)


def _noise_in(recordings: Recordings) -> Array:
    """Estimate the (3,) noise densities of the encoders, in the order of `_noise_of`.

    If the arm was held, its value comes from the rig file.
    """
    levels = [np.median(record.sigma, axis=0) / np.sqrt(RATE_HZ) for record in recordings.records]
    of_arm = [sigma[2] for sigma in levels if len(sigma) > 2] or [_noise_of(recordings.rig)[2]]
    return np.append(np.median([sigma[:2] for sigma in levels], axis=0), np.median(of_arm))


def _places(model: PresentModel) -> dict[str, tuple[int, ...]]:
    places: dict[str, tuple[int, ...]] = {}
    for i, column in enumerate(model.columns):
        if column.effect:
            places[column.effect] = (*places.get(column.effect, ()), i)
    return places


def _prior_information(prior: Prior, model: PresentModel, always: frozenset[str], hidden: Sequence[int]) -> Array:
    """Return the (k, k) prior information about ratios, b, p/b and amplitudes.

    The limits of the amplitudes define their part of the prior. Ratios that no release determines are fixed.
    """
    information = np.zeros((len(model.columns), len(model.columns)))
    bounded = np.isfinite(prior.mean)
    places = np.flatnonzero(bounded)
    information[np.ix_(places, places)] = np.linalg.inv(prior.covariance[np.ix_(bounded, bounded)])
    for i, column in enumerate(model.columns[RATIO_COLUMNS:], RATIO_COLUMNS):
        widest = np.inf if column.effect in always else STRENGTH.zeros * column.size
        information[i, i] = 1.0 / min(prior.std(column), widest) ** 2
    for i in hidden:
        information[i, i] += (HELD.exactness / model.columns[i].size) ** 2
    return information


def information_of_runs(recordings: Recordings, model: PresentModel) -> Array:
    """Compute the (k, k) Fisher information of recorded runs, cut as in a diagnosis."""
    problem, initial = recordings.cut(recordings.working_length)
    estimate = problem.with_zeros(model.estimate.changed(initial=initial))
    columns = problem.all_free(model.columns)
    A, _ = linearise(problem, estimate, columns).flat
    H, k = A.T @ A, len(model.columns)
    if len(columns) > k:
        H = H[:k, :k] - H[:k, k:] @ np.linalg.lstsq(H[k:, k:], H[k:, :k], rcond=1e-12)[0]
    return H[:k, :k]
