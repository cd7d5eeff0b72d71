"""The result of a diagnosis, as `dpr-lab diagnose --json` prints it."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.errors import RunError
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.gap.result.trust import Trust
from dpr_lab.rig_tables import AddedMass
from dpr_lab.shown import Row, Shown

Number = Annotated[float, Field(allow_inf_nan=False)]


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True, populate_by_name=True)


class Interval(_Record):
    """A number with its 90 % interval."""

    value: Number
    interval90: tuple[Number, Number]


class ClosedShare(_Record):
    """Share of the gap above the noise floor that the named effects close, on data not used for the fit."""

    estimate: Number
    """On the runs held out; where there are none, on each run as foretold from the others."""
    interval90: tuple[Number, Number]
    per_run: dict[str, Number]
    held_out: dict[str, Number] = {}
    """By whole recordings that were held out on request."""


class Gap(_Record):
    """How large the gap is, before and after."""

    floor_rad: dict[str, Number]
    before_rad: dict[str, Number]
    after_rad: dict[str, Number]
    before_Nm: dict[str, Number]
    explained_share: Number
    """Of the excess chi2 of the bare model."""
    closed_held_out: ClosedShare
    by_horizon: dict[str, dict[str, Number]] = {}
    """Segment length s -> before, after -> rms above the noise, rad."""
    free_run_rad: dict[str, dict[str, Number]] = {}
    """Run -> before, after -> rms error of a free run from its release, rad."""
    waterfall: list[dict[str, Any]] = []
    """Effects in the order in which they close the gap: name, rms above the noise after it, rad."""


class Where(_Record):
    """One place in which the gap can lie."""

    site: str
    coordinate: str
    share: Number
    sentence: str
    knots: list[Number] = []
    values: list[Number] = []
    std: list[Number] = []
    unit: str = ""


class NamedEffect(_Record):
    """One effect of the chosen set."""

    name: str
    members: list[str] = Field(alias="class")
    probability: Number
    parameters: dict[str, Interval]
    share: Number
    """Of the excess that comes back without it."""


class NamedFamily(_Record):
    """Named effects that together are one thing."""

    name: str
    words: str
    effects: list[str]
    probability: Number
    share: Number
    """Of the excess that comes back without all of them."""


class RivalEffect(_Record):
    """Another effect that could stand in its place."""

    name: str
    members: list[str] = Field(alias="class")
    probability: Number
    cosine: Number
    instead_of: str = ""


class SensorFinding(_Record):
    """A sensor fault found before any physics."""

    name: str
    run: str
    axis: str | None
    at_s: Number | None
    evidence: str


class AdvisedRelease(_Record):
    """A release that is to be recorded."""

    theta1_rad: Number
    """Absolute angles of the rods when they are let go, at rest."""
    theta2_rad: Number
    duration_s: Number
    added_mass: AddedMass | None = None
    """A known mass to be clamped on."""


class AdvisedCheck(_Record):
    """A recording or a measurement that would tell a named effect from what else it could be."""

    id: str
    """Of this diagnosis alone."""
    kind: Literal["recording", "measurement"]
    text: str
    about: str
    """The named effect whose class or alternatives it splits."""
    splits: list[str]
    """What it tells apart."""
    expected_bits: Number
    """By how much it is expected to lower the uncertainty about them."""
    measures: str = ""
    """Of a measurement, the effect whose amplitude it measures: zero where that effect is not there."""
    quantity: str = ""
    """That amplitude, with its unit."""
    release: AdvisedRelease | None = None
    """What a recording is of."""

    @property
    def amplitude(self) -> EffectParameter:
        """What a measurement measures."""
        return _amplitudes(self.measures)[self.quantity.split(",")[0]]

    @model_validator(mode="after")
    def _measures_what_is_there(self) -> Self:
        if self.measures in EFFECTS and self.quantity.split(",")[0] not in _amplitudes(self.measures):
            raise ValueError(f"{self.measures} has no amplitude {self.quantity!r}")
        return self


def _amplitudes(effect: str) -> dict[str, EffectParameter]:
    return {parameter.name: parameter for parameter in EFFECTS[effect].amplitudes}


class CheckDone(_Record):
    """The result of an advised check, and what it changed."""

    check: AdvisedCheck
    result: str
    before: dict[str, Number]
    """Probability of each candidate before it."""
    after: dict[str, Number]


class Diagnosis(Shown, _Record):
    """Where the simulation differs from the rig, which effect causes it, how sure that is and how much closes."""

    verdict: Literal["no_gap", "named", "partly_explained", "unexplained"]
    sentence: str
    basis: Literal["one release", "releases left out", "held-out runs"] = "releases left out"
    """What the verdict was tested on."""
    transfer: dict[str, dict[str, Interval]] = {}
    """Effect -> run that took no part -> share of the gap closed by the effect, of what stays without it."""
    withdrawn: list[str] = []
    """Effects that explain these recordings and do not carry over to those that took no part."""
    gap: Gap
    where: list[Where]
    where_sentence: str
    effects: list[NamedEffect]
    families: list[NamedFamily] = []
    """What several of them together are."""
    rivals: list[RivalEffect]
    probabilities: dict[str, Number]
    detectable: dict[str, dict[str, Number | None]]
    sensor_findings: list[SensorFinding]
    remedies: list[str] = []
    """What to do about each named effect, in their order."""
    advice: list[str]
    checks: list[AdvisedCheck] = []
    """The same for programs: `dpr-lab check` takes their results."""
    checks_done: list[CheckDone] = []
    """Results that were taken back, the last one last."""
    parent: str = ""
    """SHA-256 of the diagnosis that this one was made of by a check."""
    ratios: dict[str, Interval]
    ratio_covariance: list[list[Number]]
    """(5, 5) of the ratios, in their order."""
    chi2_per_dof: Number
    """Of the corrected model, over segments of 0.5 s."""
    exact_torques: bool = False
    """Whether measured torques were taken for exact: what is left is far above what their noise does."""
    segments: int
    scale_b: Number
    """kg m^2: a free swing does not fix the common scale of torques; all are relative to this b of the rig file."""
    p_over_b: Number | None = None
    """m2 L1^2 / b, which the inner rod alone swings by beside the ratios."""
    model_effects: dict[str, dict[str, Number]]
    """The corrected model's effects with all parameters, as `dpr_lab.effects.effect_params` takes them."""
    assumptions: list[str]
    evidence: Evidence | None = None
    """What it rests on; none in a diagnosis of an older version."""
    trust: Trust | None = None
    """Blind trials on plants like this rig, where they were asked for."""
    seconds: Number

    @property
    def unknowns(self) -> NDArray[np.float64]:
        """(7,) the ratios, b and p/b (nan where no run is of a rod alone), for another fit to start from."""
        p_over_b = np.nan if self.p_over_b is None else self.p_over_b
        return np.array([*(ratio.value for ratio in self.ratios.values()), self.scale_b, p_over_b])

    def _heading(self) -> str:
        return self.sentence

    def _rows(self) -> list[Row]:
        rows = [(item.name, f"{item.probability:.0%}", f"{item.share:.0%}") for item in self.effects]
        return [("effect", "probability", "share of the excess"), *rows] if rows else []

    def to_json(self) -> dict[str, Any]:
        """A plain object with the names of the interface."""
        return self.model_dump(by_alias=True)


def load_diagnosis(path: Path) -> Diagnosis:
    """Read what `diagnose --json` prints.

    Raises:
        RunError: not there, not JSON, not a diagnosis (the message names the key), or one of effects that this version
            does not know.
    """
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        kept = {key: told[key] for key in told if key != "files"} if isinstance(told, dict) else told
        found = Diagnosis.model_validate(kept)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise RunError(f"{path}: is not a diagnosis that this dpr-lab wrote: {key}: {first['msg']}") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: is not a diagnosis (JSON): {error}") from error
    named = {effect.name for effect in found.effects} | {check.measures for check in found.checks if check.measures}
    unknown = [name for name in {*found.model_effects, *named} if name not in EFFECTS]
    if unknown or any(check.about not in named for check in found.checks):
        raise RunError(f"{path}: does not fit this version: {', '.join(unknown) or 'a check of no named effect'}")
    return found
