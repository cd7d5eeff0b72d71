"""The result of a diagnosis, as `dpr-lab diagnose --json` prints it."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(allow_inf_nan=False)]


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Interval(_Record):
    """A number with its 90 % interval."""

    value: Number
    interval90: tuple[Number, Number]


class ClosedShare(_Record):
    """Share of the gap above the noise floor that the named effects close, on data not used for the fit."""

    estimate: Number
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


class Diagnosis(_Record):
    """Where the simulation differs from the rig, which effect causes it, how sure that is and how much closes."""

    verdict: Literal["no_gap", "named", "partly_explained", "unexplained"]
    sentence: str
    gap: Gap
    where: list[Where]
    where_sentence: str
    effects: list[NamedEffect]
    rivals: list[RivalEffect]
    probabilities: dict[str, Number]
    detectable: dict[str, dict[str, Number | None]]
    sensor_findings: list[SensorFinding]
    advice: list[str]
    ratios: dict[str, Interval]
    ratio_covariance: list[list[Number]]
    """(5, 5) of the ratios, in their order."""
    chi2_per_dof: Number
    """Of the corrected model, over segments of 0.5 s."""
    segments: int
    scale_b: Number
    """kg m^2: a free swing does not fix the common scale of torques; all are relative to this b of the rig file."""
    model_effects: dict[str, dict[str, Number]]
    """The corrected model's effects with all parameters, as `dpr_lab.effects.effect_vector` takes them."""
    assumptions: list[str]
    seconds: Number

    def to_json(self) -> dict[str, Any]:
        """A plain object with the names of the interface."""
        return self.model_dump(by_alias=True)
