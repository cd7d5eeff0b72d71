"""What a diagnosis rests on, for those whom it is to convince: curves, domain, uncertainty, residuals, exclusions."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class RecordingUsed(_Part):
    """One recording and its role in the diagnosis."""

    name: str
    file: str
    sha256: str
    """Of its file; empty where there is none."""
    recorded_utc: str
    """Start of the recording, ISO 8601; empty where unknown."""
    pose: str
    mounting: str
    driven: bool
    """Whether known torques drove the joints."""
    held_out: bool
    duration_s: Number
    readings: int
    """After thinning, of both joints."""


class Occupancy(_Part):
    """Time that a rod spent in each range of angle and speed."""

    angle_edges_rad: list[Number]
    """0 is upright, pi hangs; full turns are taken off."""
    speed_edges_rad_per_s: list[Number]
    fitted_s: list[list[Number]]
    """(angles, speeds) s, in the recordings that were fitted."""
    held_out_s: list[list[Number]]
    """The same in those that were held out."""


class Closing(_Part):
    """Remaining gap after one more effect is added to the model."""

    effect: str
    """Empty for the bare model."""
    left_rad: Number
    """Above the noise, rms of a reading, on the data that the verdict was tested on."""
    closed: Number
    """Share of the gap that is closed by then."""


class Whiteness(_Part):
    """Residuals of one joint under one model, in standard deviations of the noise."""

    autocorrelation: list[Number]
    """From one reading to the next, the second next and so on."""
    quantiles: list[Number]
    """At `ResidualLook.normal`."""
    beyond3: Number
    """Share of the residuals beyond three standard deviations; of normal ones 0.0027."""


class ResidualLook(_Part):
    """Residuals of the fitted recordings with free initial states of the segments."""

    spacing_s: Number
    """Between neighbouring readings."""
    readings: int
    """Of a joint."""
    normal: list[Number]
    """Quantiles of the standard normal distribution."""
    joints: dict[str, dict[str, Whiteness]]
    """Joint -> before, after."""


class Exclusion(_Part):
    """An effect that is not there, from a size on."""

    effect: str
    parameter: str
    size: Number
    """The least detectable."""
    estimate: Number
    """What these recordings show of an effect when all named effects are in the model."""
    confidence: Number
    """That it is smaller than `size`, 0 to 1."""


class UncertaintySource(_Part):
    """One contribution to the uncertainty of a predicted angle."""

    name: str
    kind: Literal["numerical", "input", "data"]
    how: str
    """How it was found, and what was put in."""
    left: Number
    """Share of what was put in that the recordings leave under the corrected model: what would show is not unsure."""
    before_rad: Number
    """By how much it moves a prediction of the bare model, rms."""
    after_rad: Number
    """The same of the corrected model."""


class RunBudget(_Part):
    """Error and uncertainty of one free run, both rms over its compared part."""

    run: str
    held_out: bool
    until_s: Number
    """End of the comparison, s after the first reading: the horizon, or the end of the free run."""
    reaches_horizon: bool
    """Whether the horizon lies within the free run."""
    growth_per_s: Number
    """Largest rate at which an error of the angles at the start grows by then."""
    error_before_rad: Number
    error_after_rad: Number
    u_before_rad: Number
    u_after_rad: Number
    area_before_rad: Number
    """Area between the distributions of the measured and of the simulated angles."""
    area_after_rad: Number
    area_noise_rad: Number
    """The same of the corrected model and itself with the noise of readings."""


class Budget(_Part):
    """Validation uncertainty: what a prediction may be off by without any fault of the model."""

    sources: list[UncertaintySource]
    error_before_rad: Number
    error_after_rad: Number
    u_before_rad: Number
    u_after_rad: Number
    runs: list[RunBudget]


class Curves(_Part):
    """Free runs before and after, and the measured curve."""

    run: str
    held_out: bool
    settled_s: Number
    """End of the interval to which the initial state was fitted, s after the first reading."""
    until_s: Number
    """The predictability horizon, or the end."""
    t_s: list[Number]
    measured_rad: list[list[Number]]
    """(n, 2) inner, outer rod, 0 = upright."""
    before_rad: list[list[Number]]
    after_rad: list[list[Number]]


class Evidence(_Part):
    """The evidence for a diagnosis."""

    version: str
    made_utc: str
    rig: str
    rig_sha256: str
    recordings: list[RecordingUsed]
    coverage: dict[str, Occupancy]
    """Rod -> map."""
    closing: list[Closing]
    residuals: ResidualLook
    exclusions: list[Exclusion]
    budget: Budget
    curves: list[Curves]
