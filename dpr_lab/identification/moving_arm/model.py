"""Result of an identification with a moving arm, which `model.json` contains."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.effects.coulomb import COULOMB_JOINT0
from dpr_lab.effects.spring import SPRING_JOINT0
from dpr_lab.errors import RunError
from dpr_lab.identification.model import EstimatedValue, FittedModel, Model, ModelPart, read_model
from dpr_lab.identification.moving_arm.unknowns import parameter_of
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.shown import counted


class ArmFitSummary(ModelPart):
    """Quality of the fit to the runs, in segments with free initial states."""

    rms_rad: dict[str, float]
    """Rms residual of the encoder readings of each joint, rad."""
    noise_rad: dict[str, float]
    """Standard deviation of the noise of the encoder readings of each joint, rad."""
    segments: int
    """Number of segments with free initial states."""
    segment_s: float
    """Median length of a segment, s."""
    chi2_per_dof: float
    """Reduced chi-square; 1 = noise only."""
    converged: bool
    """Whether the fit converged."""
    merges: list[tuple[float, float]] = []
    """Segment length, s, and reduced chi-square, for the first segments and after each merge."""


class MovingArmModel(FittedModel):
    """Identified rig with a moving arm; the model contains only determined values."""

    kind: Literal["moving_arm"] = "moving_arm"
    """Identifier of this kind of model file."""
    mounted: Literal["both", "inner"]
    """Mounted rods."""
    input: str
    """Kind of the input of the arm; empty if there is no driven run."""
    scale: Literal["a", "b"]
    """Inertia by which ratios are divided: a if only the inner rod is mounted, b for both rods."""
    undetermined: dict[str, str]
    """Unknowns that are not determined, with the reason for each."""
    covariance: list[list[float]]
    """(n, n) covariance of all unknowns, in the order of `unknowns`."""
    unknowns: list[str]
    """Names of all unknowns that were fitted."""
    absolute: dict[str, EstimatedValue]
    """Absolute values by name, SI.

    `fixed_by` is `bound` if their scale is taken from the rig file and not measured. Standard deviations and intervals
    then contain the uncertainty of the scale that the bounds of the rig file permit.
    """
    scale_sentence: str
    """Sentence on the source of the scale of absolute values."""
    swing: Annotated[list[float], Field(min_length=12, max_length=12)]
    """Fitted `SWING_PARAMETERS` of `dpr_lab.dynamics.moving_arm.swing`, divided by the scale."""
    fit: ArmFitSummary
    """Residuals, noise and segments of the fit."""
    notes: list[str] = []
    """Notes on combinations that the recordings cannot separate, and on values that the rig file contributes."""

    def _heading(self) -> str:
        rms = ", ".join(f"{1e3 * value:.3g} mrad ({name})" for name, value in self.fit.rms_rad.items())
        of_warnings = "".join(f"; warning: {warning}" for warning in self.warnings)
        return (
            f"Model of rig {self.rig.name} with a moving arm from {counted(len(self.runs), 'run')}: {rms}{of_warnings}"
        )

    @property
    def quantities(self) -> dict[str, EstimatedValue]:
        """Ratios and absolute values by name, SI."""
        return self.ratios | self.absolute

    def refuse_run(self, run: Run, rig: Rig) -> None:
        """Check that the model describes the rig and the drive of a run.

        Raises:
            RunError: the model belongs to another rig, or has another input.
        """
        name = run.file or run.name
        if (self.rig.name, self.rig.L1) != (rig.name, rig.L1) or self.mounted != rig.rods.mounted:
            of_run = f"{rig.name} (L1 = {rig.L1:g} m, rods: {rig.rods.mounted})"
            of_model = f"{self.rig.name} (L1 = {self.rig.L1:g} m, rods: {self.mounted})"
            raise RunError(f"{name}: is a run of {of_run}, but the model belongs to {of_model}")
        if run.arm_mode == "driven" and self.input != rig.input:
            inputs = f"the input of the model is {self.input or 'none'}, that of the rig file {rig.input or 'none'}"
            raise RunError(f"{name}: its arm is driven, but {inputs}")

    @property
    def sizes(self) -> dict[str, float]:
        """Absolute values of `SWING_PARAMETERS` at the scale of the model, SI."""
        scale = self.absolute[self.scale].value
        values = dict(zip(SWING_PARAMETERS, self.swing, strict=True))
        return {name: value if name == "L0" else value * scale for name, value in values.items()}

    @property
    def negative(self) -> tuple[str, ...]:
        """Friction and stiffness with an impossible negative estimate; their intervals usually contain zero."""
        values = dict(zip(SWING_PARAMETERS, self.swing, strict=True))
        return tuple(name for name in ("c1", "c2", "c0", "f0", "k0") if values[name] < 0.0)

    def without_negative(self) -> "MovingArmModel":
        """Return a copy in which negative friction and stiffness are zero."""
        negative, values = self.negative, zip(SWING_PARAMETERS, self.swing, strict=True)
        return self.model_copy(update={"swing": [0.0 if name in negative else value for name, value in values]})

    def with_swing(self, swing: Sequence[float], inertia: float) -> "MovingArmModel":
        """Return a copy with other `SWING_PARAMETERS` and another scale, whose relative uncertainty is unchanged.

        Args:
            swing: (12,) `SWING_PARAMETERS` divided by the scale
            inertia: the scale, kg m^2
        """
        assumed = self.absolute[self.scale]
        factor = inertia / assumed.value
        low, high = assumed.interval90
        update = {"value": inertia, "std": factor * assumed.std, "interval90": (factor * low, factor * high)}
        absolute = dict(self.absolute) | {self.scale: assumed.model_copy(update=update)}
        ratios = moved_ratios(self.ratios, swing, self.input, self.scale)
        return self.model_copy(update={"swing": list(swing), "ratios": ratios, "absolute": absolute})

    def with_arm_effects(self) -> "MovingArmModel":
        """Return a copy in which effects represent the stiffness k0 and the Coulomb friction f0 of the arm."""
        sizes, effects = self.sizes, dict(self.effects)
        for effect, name in ((SPRING_JOINT0, "k0"), (COULOMB_JOINT0, "f0")):
            if sizes[name]:
                effects[effect.name] = {effect.amplitudes[0].name: sizes[name]}
        absent = {SWING_PARAMETERS.index(name): 0.0 for name in ("k0", "f0")}
        swing = [absent.get(place, value) for place, value in enumerate(self.swing)]
        return self.model_copy(update={"effects": effects, "swing": swing})


def moved_ratios(
    ratios: Mapping[str, EstimatedValue], swing: Sequence[float], kind: str, letter: str
) -> dict[str, EstimatedValue]:
    """Return the ratios with the values of `SWING_PARAMETERS`; their intervals are moved accordingly."""
    return {
        name: ratio.moved(swing[SWING_PARAMETERS.index(parameter_of(name, kind, letter))])
        for name, ratio in ratios.items()
    }


AnyModel = Model | MovingArmModel
"""Identified model of a rig with a clamped, prescribed or moving arm."""


def load_model(path: Path | str) -> AnyModel:
    """Read a model that `identify` or `diagnose --out` has written.

    Args:
        path: path of the file, or of the folder of its file `model.json`

    Returns:
        `MovingArmModel` for a rig with a free or driven arm, otherwise `Model`

    Raises:
        RunError: the file is missing, not JSON, or not a model; the message names the key.
    """
    return read_model(path, {"": Model, "moving_arm": MovingArmModel})
