"""The result of an identification, as it is kept in `model.json`."""

import json
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig

Number = Annotated[float, Field(allow_inf_nan=False)]


class _Record(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Estimate(_Record):
    """A number with its standard deviation and 90 % interval."""

    value: Number
    std: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    interval90: tuple[Number, Number]
    profile90: tuple[Number | None, Number | None] | None = None
    """90 % interval by profile likelihood, where it was asked for; None for an end without a bound."""


class ParameterValue(_Record):
    """One of the nine kinetic parameters, and what fixed it.

    `data`: the recordings, given the measured values. `measured`: the bench. `bound`: nothing but the bounds of the
    search; it is one point of a family of equally good values, so it has no standard deviation.
    """

    value: Number
    std: Number | None
    fixed_by: Literal["data", "measured", "bound"]


class RigFacts(_Record):
    """What a simulation needs of the rig besides the ratios."""

    name: str
    sha256: str
    L1: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    g: Annotated[float, Field(gt=0, allow_inf_nan=False)]


class RunUsed(_Record):
    """A run that the model was identified from."""

    file: str
    sha256: str
    pose: str | None = None
    samples: int = 0
    duration_s: Number = 0.0
    chi2_per_dof: Number | None = None
    segments: int = 0
    horizon_s: Number | None = None
    """How far a free run from the fitted start state can be predicted before that state's uncertainty fills 0.1 rad."""


class Covariance(_Record):
    """A covariance matrix with the order of its rows."""

    order: list[str]
    matrix: list[list[Number]]


class Identifiable(_Record):
    """What the runs can tell of the nine parameters at all."""

    rank: int
    null_space: list[dict[str, Number]]
    """Relative changes of the parameters that leave every swing as it is."""
    advice: list[str]
    """Bench measurements that would fix more, best first."""


class Fit(_Record):
    """How well the model follows the runs, over segments with free start states."""

    rms_rad: dict[str, Number]
    """Root mean square residual by axis, `theta1` and `theta2`."""
    noise_rad: dict[str, Number]
    """Noise floor by axis, from the rest before the release, quantisation or differences."""
    segments: int
    chi2_per_dof: Number
    """Squared residual over noise variance and degrees of freedom; 1 = nothing left but noise."""
    iterations: int
    longest_segment_s: Number


class SearchRecord(_Record):
    """What the search did, generation by generation."""

    algorithm: str
    objective: str
    seed: int
    evaluations: int
    seconds: Number
    generations: int
    best: dict[str, Number]
    """The best individual of the search, before the local solver."""
    best_cost: Number
    history: dict[str, list[Number]]
    """Columns over generations: `evaluations`, `best_cost`, `best_fitness`, `population_fitness`."""


class Model(_Record):
    """An identified model: five ratios with intervals, nine values with what fixed each, and how it was found."""

    rig: RigFacts
    ratios: dict[str, Estimate]
    """a/b, d/b, e1/b, c1/b, c2/b: all that a free swing fixes (physics: the equation is homogeneous)."""
    covariance: Covariance
    cramer_rao_std: dict[str, Number]
    """The least standard deviation any unbiased estimate of a ratio can have at this noise."""
    parameters: dict[str, ParameterValue]
    base: dict[str, ParameterValue]
    """a, b, d, e1, c1, c2 in SI; their common scale is in the data only with measured values or a known added mass."""
    identifiability: Identifiable | None = None
    fit: Fit
    search: SearchRecord
    runs: list[RunUsed]
    effects: dict[str, dict[str, Number]] = {}
    """Effects beyond the base model that a diagnosis named: effect -> parameter -> value, SI."""
    warnings: list[str] = []
    """What the reader of the numbers should know."""
    failures: list[str] = []
    """Checks of its own that the identification did not pass; empty for a model to be trusted."""
    version: str = ""

    @property
    def ratio_values(self) -> NDArray[np.float64]:
        """(5,) the ratios in the order a/b, d/b, e1/b, c1/b, c2/b."""
        return np.array([estimate.value for estimate in self.ratios.values()])

    @property
    def unknowns(self) -> NDArray[np.float64]:
        """(6,) the ratios, and b."""
        return np.append(self.ratio_values, self.base["b"].value)

    def starting_point(self, rig: Rig) -> NDArray[np.float64]:
        """(6,) `unknowns`, for a fit of this rig to start from.

        Raises:
            RunError: it is a model of another rig.
        """
        if (self.rig.name, self.rig.L1) != (rig.name, rig.rig.L1):
            raise RunError(
                f"the model is of rig {self.rig.name}, L1 = {self.rig.L1:g} m, not of {rig.name}, L1 = {rig.rig.L1:g}"
                " m: identify this rig first, or leave the model out"
            )
        return self.unknowns

    def used(self, sha256: str) -> bool:
        """Whether the run with this hash took part in the identification; if not, it is held out."""
        return bool(sha256) and any(run.sha256 == sha256 for run in self.runs)

    def save(self, path: Path) -> None:
        """Write `model.json`, whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_name(f"{path.name}.new")
        fresh.write_text(self.model_dump_json(indent=1) + "\n", encoding="utf-8")
        fresh.replace(path)


def load_model(path: Path) -> Model:
    """Read `model.json`.

    Raises:
        RunError: not there, not JSON, or not a model; the message names the key.
    """
    try:
        return Model.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise RunError(f"{path}: is not a model file (JSON): {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise RunError(f"{path}: is not a model that dpr-lab wrote: {key}: {first['msg']}") from error
