"""Knowledge of the rig before the next release: estimates, Fisher information, and candidate causes.

The unknowns are the ratios, b and p/b, and the amplitudes of every effect that is detectable in a release. The
information about the unknowns is F = P^-1 + H / f. P is the prior covariance from the rig file, H the normal matrix of
the runs recorded so far, and f the variance inflation of a reading in these runs. Before the first run, F = P^-1.
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
    SCALE,
    UNKNOWN_RATIOS,
    Estimate,
    FreeParameter,
    effect_parameters,
    ratio_parameters,
    visible_ratios,
)
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.prior import STRENGTH, Prior, prior_of
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.gap.bare_model import nominal_ratios
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import RATE_HZ, record
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.identification.moving_arm.unknowns import arm_start
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.planning.information import PresentModel, informed
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import ArmState, CandidateRelease
from dpr_lab.planning.stopping import Causes, causes_of
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Mounting
from dpr_lab.run import Run
from dpr_lab.setup import Setup

RATIO_COLUMNS = len(UNKNOWN_RATIOS)
"""Number of unknowns before the amplitudes of effects: the ratios, b and p/b."""


HELD = 1e6
"""Size of a ratio that no release determines, divided by the prior standard deviation that fixes the ratio."""


@dataclass(frozen=True, slots=True)
class Acting:
    """Parts of the rig that can act in the planned or recorded releases: rods, drives and arm."""

    rods: frozenset[Mounting] = frozenset({"both"})
    """Mountings of the rods."""
    joint_drives: bool = False
    """Whether the drives of joints 1 and 2 may act."""
    arm_moves: bool = False
    """Whether the arm may move, freely or driven by its motor."""
    arm_motor: bool = False
    """Whether the motor of the arm may act."""

    @classmethod
    def of(cls, rig: Rig, limits: PlanLimits) -> "Acting":
        """Select the parts that the rig file and the limits of a plan permit."""
        states, rods = limits.arm_states(rig), frozenset(limits.allowed_rods(rig))
        return cls(rods, limits.drive is not None, states != ("held",), "driven" in states)

    def including(self, setups: Sequence[Setup]) -> "Acting":
        """Extend this selection by the parts that acted in the recordings."""
        driven = [setup.torques for setup in setups if setup.torques is not None]
        return replace(
            self,
            rods=self.rods.union(setup.mounting for setup in setups),
            joint_drives=self.joint_drives or any(torques.on_joints for torques in driven),
            arm_moves=self.arm_moves or any(setup.arm_moves for setup in setups),
            arm_motor=self.arm_motor or any(torques.on_arm is not None for torques in driven),
        )

    @property
    def elbow(self) -> bool:
        """Whether joint 2 exists in at least one of the mountings."""
        return bool(self.rods - {"inner", "outer"})

    @property
    def hidden_ratios(self) -> tuple[int, ...]:
        """Indices of ratios that no release determines, because their rod is absent."""
        if "both" in self.rods:
            return ()
        visible = visible_ratios([Setup(mounting) for mounting in self.rods])
        return tuple(i for i in range(len(UNKNOWN_RATIOS)) if i not in visible and i != SCALE)


GRAVITY_ONLY = Acting()
"""Free swings of both rods with a clamped arm."""


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Knowledge of the rig before the next release."""

    rig: Rig
    model: PresentModel
    prior: Array
    """(k, k) information of the rig file about the unknowns."""
    information: Array
    """(k, k) information F of the prior and the runs about the unknowns."""
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
    """Indices of the amplitudes of each effect among the unknowns, by the name of the effect."""
    hidden_ratios: tuple[int, ...] = ()
    """Indices of the ratios that no release determines."""
    free_run_rad: tuple[float, ...] = ()
    """Rms error of the free run along each run, rad, over the horizon of the limit; empty without such a limit."""
    open_limits: tuple[str, ...] = ()
    """Names of the limited quantities that the runs do not decide; empty before any recording."""

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
        """Indices of the unknowns that every fit estimates: ratios, b, p/b, and amplitudes of the model."""
        return [*range(RATIO_COLUMNS), *(i for name in self.named for i in self.places.get(name, ()))]


def known_before(rig: Rig, acting: Acting = GRAVITY_ONLY) -> Knowledge:
    """Return the knowledge before any recording, from the rig file alone.

    Args:
        rig: the rig
        acting: parts that may act in the planned releases; they determine which effects are considered
    """
    return _known(rig, acting, nominal_ratios(rig), {}, _noise_of(rig))


def known_after(runs: Sequence[Run], rig: Rig, diagnosis: Diagnosis, acting: Acting = GRAVITY_ONLY) -> Knowledge:
    """Return the knowledge from the rig file, the recorded runs and their diagnosis.

    The probabilities of the causes do not contain the information of held-out runs and held-out pieces. This
    information is therefore left out here as well. The uncertainty of the scale b is that of the diagnosis.

    Args:
        runs: the runs that were diagnosed
        rig: the rig
        diagnosis: diagnosis of these runs
        acting: parts that may act in the next release
    """
    used = diagnosis.evidence.recordings if diagnosis.evidence else []
    held_out = {recording.name for recording in used if recording.held_out}
    pieces, unseen, _ = in_pieces(runs, ())
    as_diagnosed = [*pieces, *unseen] if held_out.intersection(piece.name for piece in unseen) else runs
    recordings = Recordings(tuple(record(run, rig) for run in as_diagnosed), rig)
    acting = acting.including([recorded.setup for recorded in recordings.records])
    ratios = diagnosis.unknowns
    if not np.isfinite(ratios[ON_ELBOW]):
        ratios[ON_ELBOW] = nominal_ratios(rig)[ON_ELBOW]
    known = _known(rig, acting, ratios, diagnosis.model_effects, _noise_in(recordings))
    inflation = max(1.0, diagnosis.chi2_per_dof)
    fitted = recordings.only([recorded for recorded in recordings.records if recorded.run.name not in held_out])
    gained = information_of_runs(fitted, known.model) / inflation
    prior = known.prior + _of_scale(known, known.prior + gained, diagnosis.scale)
    return replace(
        known,
        model=replace(known.model, inflation=inflation),
        prior=prior,
        information=prior + gained,
        causes=tuple(causes_of(diagnosis)),
        diagnosis=diagnosis,
        made=tuple(_made(run) for run in runs),
    )


def _known(
    rig: Rig, acting: Acting, ratios: Array, effects: Mapping[str, Mapping[str, float]], noise: Array
) -> Knowledge:
    """Return the knowledge without runs, for a model with the given ratios and effects."""
    model, gain = _model(rig, ratios, effects, noise, acting), acting.arm_motor and not drive_gain(rig).known
    always = frozenset([FREE_ARM.name] * acting.arm_moves + [DRIVE_GAIN.name] * gain)
    prior = _prior_information(prior_of(rig), model, always, acting.hidden_ratios)
    places = dict[str, tuple[int, ...]]()
    for i, column in enumerate(model.columns):
        if column.effect:
            places[column.effect] = (*places.get(column.effect, ()), i)
    return Knowledge(
        rig,
        model,
        prior,
        prior,
        named=always.union(effects),
        always=always,
        places=places,
        hidden_ratios=acting.hidden_ratios,
    )


def _of_scale(known: Knowledge, F: Array, scale: Scale | None) -> Array:
    """Return the (k, k) matrix that, added to the information F, gives b the uncertainty stated by a diagnosis.

    Both uncertainties differ, because the prior of the plan is normal in b. The prior of a diagnosis is lognormal in
    the nine parameters, and for a single rod it also contains the ratios that no release determines. The entry of b is
    negative if F alone underestimates the uncertainty of b.
    """
    change = np.zeros_like(F)
    if scale is not None:
        others = [i for i in known.fitted if i != SCALE]
        std = known.model.estimate.ratios[SCALE] * max(scale.log_std, 1e-3)
        change[SCALE, SCALE] = std**-2 - schur_complement(F, others, [SCALE])[0, 0]
    return change


def _made(run: Run) -> CandidateRelease:
    """Return the release that corresponds to a recorded run."""
    _, theta1, theta2 = run.theta[np.searchsorted(run.t, 0.0)].tolist()
    arm: ArmState = run.arm_mode if run.arm_mode in ("free", "driven") else "held"
    return CandidateRelease(theta1, theta2, run.duration, run.mounting, run.added_mass, arm=arm)


def _model(
    rig: Rig, ratios: Array, effects: Mapping[str, Mapping[str, float]], noise: Array, acting: Acting
) -> PresentModel:
    """Return the model with the given effects; a moving arm without an estimate has the parameters of the rig file."""
    inertia, viscous = arm_start(rig)
    arm = {FREE_ARM.name: {"inertia_kgm2": inertia, "viscous_Nms": viscous}} if acting.arm_moves else {}
    estimate = Estimate.of(ratios, effect_params({**arm, **effects}), np.zeros((0, 4)))
    library = [effect for effect in EFFECTS.values() if _can_act(effect, rig, acting)]
    columns = (
        *ratio_parameters(estimate, range(RATIO_COLUMNS)),
        *(parameter for effect in library for parameter in effect_parameters(effect)),
    )
    tolerance = float(np.median([pose.tolerance for pose in rig.poses.values()] or [0.05]))
    rods = RodsWithEffects(rig_constants(rig))
    model = PresentModel(estimate, columns, rods, noise, tolerance / 2, rezeroed=rig.encoders.rezeroed)
    return model if acting.elbow else _of_one_rod(model, acting)


def _of_one_rod(model: PresentModel, acting: Acting) -> PresentModel:
    """Remove effects that require two rods from the model if only one rod is mounted.

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
    hidden = (effect.of_arm and not acting.arm_moves) or (effect.joints == (1,) and not acting.elbow)
    if effect.event or effect.absorbed_by or hidden:
        return False
    if not effect.driven:
        return True
    if not effect.of_arm:
        return acting.joint_drives or (acting.arm_motor and effect.stage == "input")
    unknown_gain = not drive_gain(rig).known
    return acting.arm_motor and effect is not (TORQUE_SCALE_JOINT0 if unknown_gain else DRIVE_GAIN)


def _noise_of(rig: Rig) -> Array:
    """Return the (3,) noise densities of encoders 1, 2 and 0 from the rig file, rad sqrt(s)."""
    return np.asarray(rig.reading_std[[1, 2, 0]] / np.sqrt(rig.link.rate_hz), dtype=np.float64)


def _noise_in(recordings: Recordings) -> Array:
    """Estimate the (3,) noise densities of encoders 1, 2 and 0 from recordings, rad sqrt(s).

    If the arm was held, the value of encoder 0 comes from the rig file.
    """
    levels = [np.median(record.sigma, axis=0) / np.sqrt(RATE_HZ) for record in recordings.records]
    of_arm = [sigma[2] for sigma in levels if len(sigma) > 2] or [_noise_of(recordings.rig)[2]]
    return np.append(np.median([sigma[:2] for sigma in levels], axis=0), np.median(of_arm))


def _prior_information(prior: Prior, model: PresentModel, always: frozenset[str], hidden: Sequence[int]) -> Array:
    """Return the (k, k) prior information about ratios, b, p/b and amplitudes.

    The prior of an amplitude follows from its limits. Ratios that no release determines are practically fixed.
    """
    information = np.zeros((len(model.columns), len(model.columns)))
    bounded = np.isfinite(prior.mean)
    places = np.flatnonzero(bounded)
    information[np.ix_(places, places)] = np.linalg.inv(prior.covariance[np.ix_(bounded, bounded)])
    for i, column in enumerate(model.columns[RATIO_COLUMNS:], RATIO_COLUMNS):
        widest = np.inf if column.effect in always else STRENGTH.zeros * column.size
        information[i, i] = 1.0 / min(prior.std(column), widest) ** 2
    for i in hidden:
        information[i, i] += (HELD / model.columns[i].size) ** 2
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


def schur_complement(F: Array, fitted: Sequence[int], columns: Sequence[int]) -> Array:
    """Return the information about some unknowns if the other unknowns are fitted (Schur complement).

    Args:
        F: (..., k, k) information about all unknowns
        fitted: indices of the unknowns that are fitted
        columns: indices of the unknowns whose information is returned
    """
    scale = 1 / np.sqrt(diagonal(F)[..., list(fitted)])
    across = F[..., *np.ix_(fitted, columns)] * scale[..., None]
    inner = F[..., *np.ix_(fitted, fitted)] * scale[..., None] * scale[..., None, :] + 1e-12 * np.eye(len(fitted))
    explained: Array = across.swapaxes(-2, -1) @ np.linalg.solve(inner, across)
    return F[..., *np.ix_(columns, columns)] - explained


def diagonal(F: Array) -> Array:
    """Return the (..., k) diagonals of matrices (..., k, k)."""
    return np.diagonal(F, axis1=-2, axis2=-1)
