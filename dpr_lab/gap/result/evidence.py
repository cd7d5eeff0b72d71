"""Evidence of a diagnosis: curves, valid range, uncertainty, residuals, excluded effects."""

from dataclasses import dataclass
from typing import Literal

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.saved import Number, Saved


class RecordingUsed(Saved):
    """One recording and its role in the diagnosis."""

    name: str
    file: str
    sha256: str
    """SHA-256 of its file; empty if there is none."""
    recorded_utc: str
    """Start of the recording, ISO 8601; empty where unknown."""
    pose: str
    mounting: str
    driven: bool
    """Whether known torques drove the joints."""
    held_out: bool
    duration_s: Number
    readings: int
    """Number of readings that the diagnosis uses, of all joints together."""


class Occupancy(Saved):
    """Time that a rod spent in each range of angle and speed."""

    angle_edges_rad: list[Number]
    """Edges of the angles: 0 is upright, pi hanging, full turns subtracted."""
    speed_edges_rad_per_s: list[Number]
    fitted_s: list[list[Number]]
    """(angles, speeds) time in each cell over the fitted recordings, s."""
    held_out_s: list[list[Number]]
    """(angles, speeds) time in each cell over the held-out recordings, s."""


class Closing(Saved):
    """Remaining gap after one additional effect in the model."""

    effect: str
    """Added effect; empty for the bare model."""
    left_rad: Number
    """Gap above the noise, rms of a reading, on the data on which the verdict was tested."""
    closed: Number
    """Share of the gap closed so far."""


class Whiteness(Saved):
    """Residuals of one joint under one model, in standard deviations of the noise."""

    autocorrelation: list[Number]
    """Autocorrelation at lag 1, 2 and so on."""
    quantiles: list[Number]
    """Quantiles of the residuals at `ResidualLook.normal`."""
    beyond3: Number
    """Share of the residuals beyond three standard deviations; 0.0027 for a normal distribution."""


class ResidualLook(Saved):
    """Residuals of the fitted recordings with free initial states of the segments."""

    spacing_s: Number
    """Time between neighbouring readings."""
    readings: int
    """Number of residuals of a joint."""
    normal: list[Number]
    """Quantiles of the standard normal distribution."""
    joints: dict[str, dict[str, Whiteness]]
    """Joint -> residuals before and after."""


@dataclass(frozen=True, slots=True)
class ExclusionLevels:
    """Minimum confidence with which an effect is excluded at its minimum detectable size."""

    sure: float = 0.95
    """For an effect of known shape: its estimate is below 3.4 standard deviations."""
    of_shapes: float = 0.84
    """For an effect of unknown shape: its largest estimate over all shapes is below 4 standard deviations."""


EXCLUDED = ExclusionLevels()


class Exclusion(Saved):
    """An effect that is excluded above a size."""

    effect: str
    parameter: str
    size: Number
    """Minimum detectable size."""
    estimate: Number
    """Estimate of the amplitude from these recordings with all named effects in the model."""
    confidence: Number
    """Confidence that the effect is smaller than `size`, 0 to 1."""
    interval90: tuple[Number, Number] | None = None
    """90 % interval of the amplitude, fitted together with the others of its effect, over all shapes of the effect;
    None if the recordings do not separate them.
    """

    @property
    def is_excluded(self) -> bool:
        """Whether the effect is smaller than `size`, by an equivalence test.

        The estimate of an effect of unknown order, frequency or speed is the largest of some hundred. It exceeds the
        limit of the others, 3.4 standard deviations, by chance on one rig in four. Its limit is 4, which excludes 5.6
        standard deviations instead of 5 with the same confidence.
        """
        return self.confidence >= (EXCLUDED.of_shapes if EFFECTS[self.effect].shapes else EXCLUDED.sure)


class JointFriction(Saved):
    """Friction torque of a joint against its speed: viscous friction, named laws, and a free-form curve."""

    speed_rad_per_s: list[Number]
    """Speeds of the joint, ascending, both directions; the joint reaches the last one in both."""
    torque_Nm: list[Number]
    """Friction torque, positive against a positive speed, at the assumed b."""
    std_Nm: list[Number]
    """Its standard deviation at each speed."""
    coefficients: int
    """Number of fitted values on which it depends."""
    back_emf: bool = False
    """Whether the torque contains the back-EMF of a voltage drive, which acts like viscous friction."""


class UncertaintySource(Saved):
    """One contribution to the uncertainty of a predicted angle."""

    name: str
    kind: Literal["numerical", "input", "data"]
    how: str
    """Source of the value, and the assumed uncertainty."""
    left: Number
    """Factor by which the recordings reduce the assumed uncertainty under the corrected model, because a larger
    error would be visible.
    """
    before_rad: Number
    """Resulting change of a prediction of the bare model, rms."""
    after_rad: Number
    """Resulting change of a prediction of the corrected model, rms."""


class RunBudget(Saved):
    """Error and uncertainty of one free run, both rms over its compared part."""

    run: str
    held_out: bool
    until_s: Number
    """End of the comparison, s after the first reading: the horizon, or the end of the free run."""
    reaches_horizon: bool
    """Whether the horizon lies within the free run."""
    growth_per_s: Number
    """Largest rate at which an initial error of the angles grows until then."""
    error_before_rad: Number
    error_after_rad: Number
    u_before_rad: Number
    u_after_rad: Number
    area_before_rad: Number
    """Area between the distributions of the measured and of the simulated angles."""
    area_after_rad: Number
    area_noise_rad: Number
    """Area between the distributions of the corrected model and of the same model with noise of the readings."""


class Budget(Saved):
    """Validation uncertainty: possible error of a prediction by a correct model."""

    sources: list[UncertaintySource]
    error_before_rad: Number
    error_after_rad: Number
    u_before_rad: Number
    u_after_rad: Number
    runs: list[RunBudget]


class Curves(Saved):
    """Measured curve, and free runs of the bare and of the corrected model."""

    run: str
    held_out: bool
    settled_s: Number
    """End of the interval to which the initial state was fitted, s after the first reading."""
    until_s: Number
    """The predictability horizon, or the end of the free run."""
    t_s: list[Number]
    measured_rad: list[list[Number]]
    """(n, 2) angles of the inner and outer rod, 0 = upright."""
    before_rad: list[list[Number]]
    after_rad: list[list[Number]]
    rods: int = 2
    """Number of rods that swing separately: with one, only the first angle has a meaning."""
    arm_rad: list[list[Number]] = []
    """(n, 3) angle of an arm that is free or driven: measured, before and after."""
    input: list[Number] = []
    """(n,) input of the arm's drive."""
    input_name: str = ""
    """Name of the input with its unit."""


class Evidence(Saved):
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
    friction: dict[str, JointFriction] = {}
    """Joint -> its friction torque; empty in a file of an older version."""
    budget: Budget
    curves: list[Curves]
