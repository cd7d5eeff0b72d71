"""Result of an identification, which `model.json` contains."""

import json
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import AfterValidator, PositiveFloat, ValidationError, computed_field, model_validator

from dpr_lab.arrays import Array
from dpr_lab.configs import first_fault
from dpr_lab.dynamics.base import ALONE, BASE, RATIOS, base_from_ratios
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError, all_printable
from dpr_lab.fitting.estimate import UNKNOWN_RATIOS
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.identification.scaling.values import (
    EstimatedValue,
    ModelPart,
    ParameterValue,
    base_alone,
    ratios_alone,
)
from dpr_lab.rig import PARAMETERS, Rig, of_inner_rod
from dpr_lab.run import Run
from dpr_lab.search import search_words
from dpr_lab.shown import FIXED_BY, Row, Shown, counted
from dpr_lab.whole_file import in_folder, not_json, read_text, write_text

MODEL = "model.json"
RODS = ("theta1", "theta2")
Kept = TypeVar("Kept")
AnyFittedModel = TypeVar("AnyFittedModel", bound="FittedModel")


def by_name(names: Sequence[str]) -> Callable[[dict[str, Kept]], dict[str, Kept]]:
    """Return a validator that checks the names of the entries of a table, and orders the entries."""

    def ordered(table: dict[str, Kept]) -> dict[str, Kept]:
        if set(table) != set(names):
            missing = ", ".join(name for name in names if name not in table) or "none"
            unknown = ", ".join(name for name in table if name not in names) or "none"
            raise ValueError(f"must contain {', '.join(names)}; missing: {missing}; unknown: {unknown}")
        return {name: table[name] for name in names}

    return ordered


def of_rods(ratios: dict[str, Kept]) -> dict[str, Kept]:
    """Check that the ratios belong to both rods, or to the inner rod alone."""
    return by_name(ALONE if set(ratios) == set(ALONE) else RATIOS)(ratios)


class RigFacts(ModelPart):
    """Constants of the rig that a simulation uses in addition to the ratios."""

    name: str
    """Name of the rig."""
    sha256: str
    """SHA-256 of the rig file."""
    L1: PositiveFloat
    """Distance between the two joints along the inner rod, m."""
    g: PositiveFloat
    """Gravity, m/s^2."""

    @classmethod
    def of(cls, rig: Rig) -> "RigFacts":
        """Extract the constants from a rig file."""
        return cls(name=rig.name, sha256=rig.sha256, L1=rig.L1, g=rig.g)


class RunUsed(ModelPart):
    """A run that was used in the identification."""

    file: str
    """Name of the run file, or name of a run that has no file."""
    sha256: str
    """SHA-256 of the file; empty if there is no file."""
    pose: str | None = None
    """Name of the pose of the run; None if unknown."""
    samples: int = 0
    """Number of samples."""
    duration_s: float = 0.0
    """Time from the release to the last sample, s."""
    chi2_per_dof: float | None = None
    """Reduced chi-square of this run alone."""
    segments: int = 0
    """Number of segments with free initial states."""
    horizon_s: float | None = None
    """Predictability horizon, s: the uncertainty of the initial state then reaches 0.1 rad in a free run."""
    torque_kind: str = ""
    """Kind of the known torques, `measured` or `commanded`; empty if unknown."""
    zeros_rad: list[float] = []
    """Fitted zero offsets of encoders 1 and 2 in this run, rad; empty for fixed zeros."""
    truncated: bool = False
    """Whether the recording was interrupted or damaged."""

    @classmethod
    def of(cls, run: Run, **figures: Any) -> "RunUsed":
        """Create the entry of a run; `figures` contains the other fields by name."""
        return cls(
            file=str(run.file or run.name), sha256=run.sha256, pose=run.pose, truncated=not run.complete, **figures
        )


class Covariance(ModelPart):
    """A covariance matrix and the order of its rows."""

    order: list[str]
    """Names of the n unknowns, in the order of rows and columns."""
    matrix: list[list[float]]
    """(n, n) covariance matrix, SI."""

    @model_validator(mode="after")
    def _square(self) -> "Covariance":
        n = len(self.order)
        in_order = [name for name in UNKNOWN_RATIOS if name in self.order]
        if in_order != self.order or any(len(row) != n for row in [*self.matrix, self.matrix]):
            raise ValueError(
                f"must be a square matrix; its rows and columns are some of {', '.join(UNKNOWN_RATIOS)}, in this order"
            )
        return self


class Identifiable(ModelPart):
    """Identifiable directions in the space of the nine parameters."""

    rank: int
    """Number of directions, of nine, that the runs determine."""
    null_space: list[dict[str, float]]
    """Directions that have no influence on any swing, as relative changes of the parameters."""
    advice: list[str]
    """Bench measurements that would determine more parameters, best first."""


class FitSummary(ModelPart):
    """Quality of the fit to the runs, in segments with free initial states."""

    rms_rad: Annotated[dict[str, float], AfterValidator(by_name(RODS))]
    """Rms residual of `theta1` and `theta2`, rad."""
    noise_rad: Annotated[dict[str, float], AfterValidator(by_name(RODS))]
    """Noise floor of `theta1` and `theta2`, rad, from the rest before the release, quantisation or differences."""
    segments: int
    """Number of segments with free initial states."""
    chi2_per_dof: float
    """Reduced chi-square; 1 = noise only."""
    iterations: int
    """Number of iterations of the local solver."""
    longest_segment_s: float
    """Length of the longest segment, s."""


class SearchRecord(ModelPart):
    """Settings and result of the global search, with its history by generation."""

    algorithm: str
    """Name of the algorithm in `dpr_lab.search.ALGORITHMS`."""
    objective: str
    """Name of the objective in `dpr_lab.identification.objectives.OBJECTIVES`."""
    seed: int
    """Seed of all random numbers."""
    evaluations: int
    """Number of simulated candidates."""
    seconds: float
    """Duration of the search, s."""
    generations: int
    """Number of the last generation."""
    best: dict[str, float]
    """Best individual of the search, before the local solver."""
    best_cost: float
    """Cost of the best individual, in the unit of the objective."""
    history: dict[str, list[float]]
    """Columns of the history by generation: `evaluations`, `best_cost`, `best_fitness`, `population_fitness`."""


class FittedModel(Shown, ModelPart):
    """Common part of the models with a clamped and with a moving arm."""

    rig: RigFacts
    """Rig of the model."""
    ratios: dict[str, EstimatedValue]
    """Ratios of inertias, frictions, gravity torques and gain to the inertia of the scale, SI; L0 of an arm in m."""
    effects: dict[str, dict[str, float]] = {}
    """Values of the named effects of a diagnosis, by effect and parameter, SI."""
    runs: list[RunUsed]
    """Runs used in the identification."""
    warnings: list[str] = []
    """Warnings on the interpretation of the values."""
    failures: list[str] = []
    """Failed checks of the identification; empty for a reliable model."""
    version: str = ""
    """Version of dpr-lab that wrote the file."""

    @property
    @abstractmethod
    def quantities(self) -> Mapping[str, EstimatedValue | ParameterValue]:
        """Ratios and absolute values by name, SI."""

    def _rows(self) -> list[Row]:
        rows = [
            (name, f"{entry.value:.5g}", "" if entry.std is None else f"{entry.std:.2g}", FIXED_BY[entry.fixed_by])
            for name, entry in self.quantities.items()
            if name not in self.ratios or entry.fixed_by == "data"
        ]
        return [("", "value", "std", "determined by"), *rows]

    def used(self, sha256: str) -> bool:
        """Check whether the run with this hash was fitted; otherwise it is held out."""
        return bool(sha256) and any(run.sha256 == sha256 for run in self.runs)

    def save(self, path: Path | str) -> None:
        """Write `model.json` atomically.

        Raises:
            RunError: the file cannot be written.
        """
        write_text(Path(path), self.model_dump_json(indent=1) + "\n", RunError)


class Model(FittedModel):
    """Identified model: five ratios with intervals, and nine parameters with sources."""

    ratios: Annotated[dict[str, EstimatedValue], AfterValidator(of_rods)]
    """Ratios a/b, d/b, e1/b, c1/b, c2/b, or e1/a and c1/a for the inner rod alone.

    A free swing determines only these quantities, because its equation of motion is homogeneous.
    """
    fitted: list[EstimatedValue] = []
    """Fitted ratios a/b, d/b, e1/b, c1/b, c2/b if only the inner rod is mounted; empty for both rods.

    Parts that are not mounted have the values of the rig file. These ratios are initial values for other commands, not
    results.
    """
    covariance: Covariance
    """Covariance of the unknowns that the runs determine.

    Ratios that they do not determine, for example with a clamped elbow, are treated as known. Standard deviations and
    intervals contain their uncertainty.
    """
    cramer_rao_std: Annotated[dict[str, float], AfterValidator(lambda ratios: ratios and of_rods(ratios))]
    """Cramer-Rao bound of the standard deviation of each ratio at this noise; empty in a corrected model of one rod."""
    parameters: Annotated[dict[str, ParameterValue], AfterValidator(by_name(PARAMETERS))]
    """The nine kinetic parameters by name, in SI units, with their sources."""
    base: Annotated[dict[str, ParameterValue], AfterValidator(by_name(BASE))]
    """Base parameters a, b, d, e1, c1, c2 of the whole rig, SI.

    Only measured values or a known added mass determine their common scale. If only the inner rod is mounted, these
    values include the outer rod of the rig file and are no results: use `alone`, which `print(model)` shows.
    """
    scale: Scale | None = None
    """Inertia that absolute sizes assume: b, or a of the inner rod alone; None in a file of an older version."""
    identifiability: Identifiable | None = None
    """Directions that the runs determine; None in a corrected model."""
    fit: FitSummary
    """Residuals, noise and segments of the fit."""
    search: SearchRecord
    """Result of the global search."""
    p_over_b: PositiveFloat | None = None
    """Additional ratio m2 L1^2 / b for runs with only the inner rod; None if there are no such runs."""

    def _heading(self) -> str:
        by_rod = [*self.fit.rms_rad.items()][: 1 if self.fitted else 2]
        rms = " and ".join(f"{1e3 * value:.3g} mrad ({name})" for name, value in by_rod)
        doubts = f"; {len(self.failures)} checks failed" if self.failures else ""
        search = search_words(self.search.algorithm)
        of_warnings = "".join(f"; warning: {warning}" for warning in self.warnings)
        return (
            f"Model of rig {self.rig.name} from {counted(len(self.runs), 'run')}, {search}: {rms}{doubts}{of_warnings}"
        )

    @computed_field
    @property
    def alone(self) -> dict[str, ParameterValue]:
        """Base parameters a, e1 and c1, SI, if only the inner rod is mounted; empty for both rods."""
        if not self.fitted or self._scale is None:
            return {}
        return base_alone(self._scale, self.ratios["e1/a"]) | {"c1": self.parameters["c1"]}

    @property
    def mounted(self) -> dict[str, ParameterValue]:
        """The kinetic parameters of the mounted parts by name, SI."""
        if not self.fitted:
            return self.parameters
        return {name: self.parameters[name] for name in of_inner_rod(self.parameters["mb"].value)}

    @property
    def _scale(self) -> Scale | None:
        """Scale of the mounted rods; older files of a rig with a single rod contain b instead of a."""
        if self.scale is None or not self.fitted or self.scale.inertia == "a":
            return self.scale
        return self.scale.as_inertia("a", self.fitted[0].value - (self.p_over_b or 0.0))

    @property
    def all_ratios(self) -> "dict[str, EstimatedValue]":
        """The five ratios to b; for a single rod, some of them come from the rig file."""
        return dict(zip(RATIOS, self.fitted, strict=True)) if self.fitted else self.ratios

    def with_ratios(self, values: Sequence[float]) -> "Model":
        """Return a copy with given values of the five ratios, which have no uncertainty."""
        five = [EstimatedValue(value=value, std=0.0, interval90=(value, value)) for value in values]
        if not self.fitted:
            return self.model_copy(update={"ratios": dict(zip(RATIOS, five, strict=True))})
        alone = ratios_alone(five, self.p_over_b or 0.0, self.rig.g / self.rig.L1)
        return self.model_copy(update={"ratios": alone, "fitted": five})

    def scaled_ratios(self) -> "Model":
        """Return a copy of the model whose base parameters are computed from the ratios.

        The copy is used for comparisons with recordings. It differs from the model only after `with_ratios`, or if an
        older version wrote the model. In older models the base parameters follow from the nine parameters, which the
        bounds of the rig file may shift.
        """
        values = self.base["b"].value * base_from_ratios([ratio.value for ratio in self.all_ratios.values()])
        return self.with_base(values.tolist())

    def with_base(self, values: Sequence[float]) -> "Model":
        """Return a copy with different base parameters (6,) and unchanged uncertainties."""
        pairs = zip(self.base.items(), values, strict=True)
        return self.model_copy(update={"base": {k: v.model_copy(update={"value": value}) for (k, v), value in pairs}})

    @property
    def quantities(self) -> dict[str, EstimatedValue | ParameterValue]:
        """Ratios, base parameters, and kinetic parameters of the mounted parts by name, SI."""
        return {**self.ratios, **(self.alone or self.base), **self.mounted}  # c1 and c2 are base parameters too

    @property
    def sizes(self) -> dict[str, float]:
        """Base parameters at the scale of the model, SI."""
        return {name: parameter.value for name, parameter in self.base.items()}

    @property
    def ratio_values(self) -> Array:
        """(5,) ratios a/b, d/b, e1/b, c1/b, c2/b, defined in docs/theory.md."""
        return np.array([estimate.value for estimate in self.all_ratios.values()])

    @property
    def scale_sentence(self) -> str:
        """Sentence that states the inertia b, which scales all masses, inertias and torques, and its uncertainty."""
        if self._scale is not None:
            return self._scale.sentence
        end = "." if self.base["b"].fixed_by != "bound" else " (not measured)."
        return f"Masses, inertias and torques are computed with b = {self.base['b'].value:.4g} kg m^2{end}"

    @property
    def unknowns(self) -> Array:
        """Array (7,) of the five ratios, b and p/b."""
        b = self.sizes["b"]
        return np.append(self.ratio_values, [b, self.p_over_b or self.parameters["m2"].value * self.rig.L1**2 / b])

    def starting_point(self, rig: Rig) -> Array:
        """Return the (7,) initial values of a fit: the five ratios, b and p/b.

        Raises:
            RunError: the model belongs to another rig.
        """
        if (self.rig.name, self.rig.L1) != (rig.name, rig.L1):
            fitted, expected = (f"{facts.name}, L1 = {facts.L1:g} m" for facts in (self.rig, rig))
            advice = "use the rig file of this model, or identify this rig first"
            raise RunError(f"the model belongs to rig {fitted}, not to {expected}: {advice}")
        return self.unknowns


def load_model(path: Path | str) -> Model:
    """Read a model of a clamped arm; see `read_model` for the file and the errors."""
    return read_model(path, {"": Model})


def read_model(path: Path | str, kinds: Mapping[str, type[AnyFittedModel]]) -> AnyFittedModel:
    """Read a model from the file or the folder that `identify` or `diagnose --out` has written.

    `kinds` contains the accepted classes by the key `kind` of the file, and the class of files without this key by "".

    Raises:
        RunError: the file is missing, not JSON, or not a model of these kinds; the message names the key.
    """
    path = in_folder(Path(path), MODEL)
    try:
        content = all_printable(json.loads(read_text(path, RunError)))
        keys = content if isinstance(content, dict) else {}
        kind = "moving_arm" if keys.get("kind") == "moving_arm" else ""
        if kind not in kinds:
            raise RunError(f"{path}: is a model of a rig with a moving arm, which only `compare` and `export` accept")
        if "verdict" in keys:
            raise RunError(f"{path}: is a diagnosis; its corrected model is model.json in the same folder")
        model = kinds[kind].model_validate(content)
    except ValidationError as error:
        fault = f"is not a model of dpr-lab: {first_fault(error)}"
        raise RunError(f"{path}: {fault}: give {MODEL}, which `identify` or `diagnose --out` has written") from error
    except (ValueError, RecursionError) as error:  # other encoding, invalid JSON, a number of thousands of digits
        raise RunError(f"{path}: {not_json(error, 'a model', MODEL, '`identify` or `diagnose --out`')}") from error
    for name, values in model.effects.items():
        effect = EFFECTS.get(name)
        if effect is None or not set(values) <= {parameter.name for parameter in effect.parameters}:
            fault = f"effects.{name}: unknown effect or parameters ({', '.join(values)}): update dpr-lab"
            raise RunError(f"{path}: {fault}")
    return model
