"""The result of an identification, as it is kept in `model.json`."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from dpr_lab.dynamics.base import BASE, RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError, printable
from dpr_lab.fitting.estimate import UNKNOWN_RATIOS
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.search import search_words
from dpr_lab.shown import FIXED_BY, Row, Shown
from dpr_lab.whole_file import regular, write_text

RODS = ("theta1", "theta2")

Number = Annotated[float, Field(allow_inf_nan=False)]


class _Record(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, defer_build=True)


Kept = TypeVar("Kept")


def by_name(names: Sequence[str]) -> Callable[[dict[str, Kept]], dict[str, Kept]]:
    """A table of these names, in this order."""

    def ordered(table: dict[str, Kept]) -> dict[str, Kept]:
        if set(table) != set(names):
            missing = ", ".join(name for name in names if name not in table) or "none"
            unknown = ", ".join(name for name in table if name not in names) or "none"
            raise ValueError(f"must hold {', '.join(names)}; missing: {missing}; unknown: {unknown}")
        return {name: table[name] for name in names}

    return ordered


class EstimatedValue(_Record):
    """A number with its standard deviation and 90 % interval."""

    value: Number
    """The estimate, SI."""
    std: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    """Standard deviation, in the unit of the value."""
    interval90: tuple[Number, Number]
    """90 % interval, in the unit of the value."""
    profile90: tuple[Number | None, Number | None] | None = None
    """90 % interval by profile likelihood, where it was asked for; None for an end without a bound."""
    fixed_by: Literal["data", "bound"] = "data"
    """`bound`: runs show it hardly or not at all; value and std rest on the rig file's nominal values and bounds."""


class ParameterValue(_Record):
    """One of the nine kinetic parameters and its source.

    `data`: the recordings, given the measured values. `measured`: the bench. `bound`: nothing but the bounds of the
    search; it is one point of a family of equally good values, so it has no standard deviation.
    """

    value: Number
    """The value, SI."""
    std: Number | None
    """Standard deviation, SI; None for a value that only bounds fix."""
    fixed_by: Literal["data", "measured", "bound"]
    """What fixed it, as above."""
    interval90: tuple[Number, Number] | None = None
    """90 % interval by the recordings and the rig file; of a value that only bounds fix, by those bounds as a prior."""


class RigFacts(_Record):
    """Constants of the rig that a simulation needs besides the ratios."""

    name: str
    """Name of the rig."""
    sha256: str
    """SHA-256 of the rig file."""
    L1: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Distance of the two joints along the inner rod, m."""
    g: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Gravity, m/s^2."""


class RunUsed(_Record):
    """A run that the model was identified from."""

    file: str
    """Its run file, or its name."""
    sha256: str
    """SHA-256 of the file; empty where there is none."""
    pose: str | None = None
    """Name of the pose it was released from."""
    samples: int = 0
    """Number of samples."""
    duration_s: Number = 0.0
    """From the release to the last sample, s."""
    chi2_per_dof: Number | None = None
    """Squared residual over noise variance and degrees of freedom, of this run alone."""
    segments: int = 0
    """Number of segments with free initial states."""
    horizon_s: Number | None = None
    """How long a free run from the fitted initial state can be predicted: until its uncertainty fills 0.1 rad."""
    torque_kind: str = ""
    """`measured` or `commanded`: the known torques that drove it, where their kind is known."""
    zeros_rad: list[Number] = []
    """Fitted zero offsets of encoders 1 and 2 in this run; empty where they keep their zeros."""


class Covariance(_Record):
    """A covariance matrix with the order of its rows."""

    order: list[str]
    """Names of the n unknowns, in the order of rows and columns."""
    matrix: list[list[Number]]
    """(n, n), SI."""

    @model_validator(mode="after")
    def _square(self) -> "Covariance":
        n = len(self.order)
        in_order = [name for name in UNKNOWN_RATIOS if name in self.order]
        if in_order != self.order or any(len(row) != n for row in [*self.matrix, self.matrix]):
            raise ValueError(
                f"must be a square matrix in the order {', '.join(UNKNOWN_RATIOS)}, of those that it is of"
            )
        return self


class Identifiable(_Record):
    """Identifiable directions of the nine parameters."""

    rank: int
    """Number of the nine directions that the runs determine."""
    null_space: list[dict[str, Number]]
    """Relative changes of the parameters that leave every swing as it is."""
    advice: list[str]
    """Bench measurements that would fix more, best first."""


class FitSummary(_Record):
    """Quality of the fit of each run, over segments with free initial states."""

    rms_rad: Annotated[dict[str, Number], AfterValidator(by_name(RODS))]
    """Root mean square residual by axis, `theta1` and `theta2`."""
    noise_rad: Annotated[dict[str, Number], AfterValidator(by_name(RODS))]
    """Noise floor by axis, from the rest before the release, quantisation or differences."""
    segments: int
    """Number of segments with free initial states."""
    chi2_per_dof: Number
    """Squared residual over noise variance and degrees of freedom; 1 = noise only."""
    iterations: int
    """Iterations of the local solver."""
    longest_segment_s: Number
    """Length of the longest segment, s."""


class SearchRecord(_Record):
    """History of the search, by generation."""

    algorithm: str
    """A name of `dpr_lab.search.ALGORITHMS`."""
    objective: str
    """A name of `dpr_lab.identification.objectives.OBJECTIVES`."""
    seed: int
    """Seed of everything random."""
    evaluations: int
    """Number of candidates simulated."""
    seconds: Number
    """Time it took, s."""
    generations: int
    """Number of the last generation."""
    best: dict[str, Number]
    """The best individual of the search, before the local solver."""
    best_cost: Number
    """Cost of the best individual, in the unit of the objective."""
    history: dict[str, list[Number]]
    """Columns over generations: `evaluations`, `best_cost`, `best_fitness`, `population_fitness`."""


class Model(Shown, _Record):
    """An identified model: five ratios with intervals, nine values with what fixed each, and how it was identified."""

    rig: RigFacts
    """The rig that it is of."""
    ratios: Annotated[dict[str, EstimatedValue], AfterValidator(by_name(RATIOS))]
    """a/b, d/b, e1/b, c1/b, c2/b: all that a free swing fixes (physics: the equation is homogeneous)."""
    covariance: Covariance
    """Covariance of the unknowns that the runs show."""
    cramer_rao_std: Annotated[dict[str, Number], AfterValidator(by_name(RATIOS))]
    """Cramer-Rao bound of the standard deviation of each ratio at this noise."""
    parameters: Annotated[dict[str, ParameterValue], AfterValidator(by_name(PARAMETERS))]
    """The nine kinetic parameters by name, SI, and what fixed each."""
    base: Annotated[dict[str, ParameterValue], AfterValidator(by_name(BASE))]
    """a, b, d, e1, c1, c2 in SI; their common scale is in the data only with measured values or a known added mass."""
    scale: Scale | None = None
    """The b that absolute sizes assume, its interval and what fixed it; None in a file of an older version."""
    identifiability: Identifiable | None = None
    """What the runs determine; None in a corrected model."""
    fit: FitSummary
    """Residuals, noise and segments of the fit."""
    search: SearchRecord
    """What the global search did."""
    runs: list[RunUsed]
    """The runs that it was identified from."""
    p_over_b: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """m2 L1^2 / b, which the inner rod alone depends on in addition to the ratios; None where no run was of one."""
    effects: dict[str, dict[str, Number]] = {}
    """Effects beyond the base model that a diagnosis named: effect -> parameter -> value, SI."""
    warnings: list[str] = []
    """Warnings on the interpretation of the values."""
    failures: list[str] = []
    """Checks of its own that the identification did not pass; empty for a model to be trusted."""
    version: str = ""
    """Version of dpr-lab that wrote it."""

    def _heading(self) -> str:
        rms = " and ".join(f"{1e3 * value:.3g} mrad ({name})" for name, value in self.fit.rms_rad.items())
        doubts = f"; {len(self.failures)} checks failed" if self.failures else ""
        search = search_words(self.search.algorithm)
        return f"Model of rig {self.rig.name} from {len(self.runs)} runs, {search}: {rms}{doubts}"

    def _rows(self) -> list[Row]:
        rows = [
            (
                name,
                f"{estimate.value:.5g}",
                "" if estimate.std is None else f"{estimate.std:.2g}",
                FIXED_BY[estimate.fixed_by],
            )
            for name, estimate in {**self.ratios, **self.parameters}.items()
        ]
        return [("", "value", "std", "fixed by"), *rows]

    @property
    def ratio_values(self) -> NDArray[np.float64]:
        """(5,) the ratios in the order a/b, d/b, e1/b, c1/b, c2/b."""
        return np.array([estimate.value for estimate in self.ratios.values()])

    @property
    def scale_sentence(self) -> str:
        """The value of b that all masses, inertias and torques assume, with its uncertainty."""
        if self.scale is not None:
            return self.scale.sentence
        known = self.base["b"].fixed_by != "bound"
        return f"Masses, inertias and torques assume b = {self.base['b'].value:.4g} kg m^2" + (
            "." if known else " (not measured)."
        )

    @property
    def unknowns(self) -> NDArray[np.float64]:
        """(7,) the ratios, b and p/b."""
        b = self.base["b"].value
        p_over_b = self.p_over_b or self.parameters["m2"].value * self.rig.L1**2 / b
        return np.append(self.ratio_values, [b, p_over_b])

    def starting_point(self, rig: Rig) -> NDArray[np.float64]:
        """(7,) `unknowns`, for a fit of this rig to start from.

        Raises:
            RunError: it is a model of another rig.
        """
        if (self.rig.name, self.rig.L1) != (rig.name, rig.L1):
            raise RunError(
                f"the model is of rig {self.rig.name}, L1 = {self.rig.L1:g} m, not of {rig.name}, L1 = {rig.L1:g}"
                " m: identify this rig first, or leave the model out"
            )
        return self.unknowns

    def used(self, sha256: str) -> bool:
        """Whether the run with this hash took part in the identification; if not, it is held out."""
        return bool(sha256) and any(run.sha256 == sha256 for run in self.runs)

    def save(self, path: Path) -> None:
        """Write `model.json`, whole or not at all.

        Raises:
            RunError: it cannot be written.
        """
        write_text(path, self.model_dump_json(indent=1) + "\n", RunError)


def load_model(path: Path) -> Model:
    """Read `model.json`.

    Raises:
        RunError: not there, not JSON, or not a model; the message names the key.
    """
    try:
        model = Model.model_validate(_printable(json.loads(regular(path, RunError).read_text(encoding="utf-8"))))
        _refuse_unknown_effects(model)
        return model
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise RunError(f"{path}: is not a model that dpr-lab wrote: {key}: {first['msg']}") from error
    except (ValueError, RecursionError) as error:  # text of another coding, no JSON, a number of thousands of digits
        raise RunError(f"{path}: is not a model file (JSON): {error}") from error


def _printable(value: Any) -> Any:
    """JSON values whose words can be shown."""
    if isinstance(value, dict):
        return {printable(key): _printable(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_printable(entry) for entry in value]
    return printable(value) if isinstance(value, str) else value


def _refuse_unknown_effects(model: Model) -> None:
    for name, values in model.effects.items():
        known = [parameter.name for parameter in EFFECTS[name].parameters] if name in EFFECTS else []
        if name not in EFFECTS or not set(values) <= set(known):
            raise ValueError(f"effects.{name}: no such effect, or not with {', '.join(values)}: update dpr-lab")
