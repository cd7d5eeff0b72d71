"""Types of the evidence for a diagnosis: curves, valid range, uncertainty, residuals, excluded effects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.saved import Saved


class RecordingUsed(Saved):
    """One recording of a diagnosis, with its role."""

    name: str
    file: str
    sha256: str
    """SHA-256 of the file of the recording; empty if the recording was not read from a file."""
    recorded_utc: str
    """Start of the recording, ISO 8601; empty if unknown."""
    pose: str
    mounting: str
    driven: bool
    """Whether known torques drove the joints."""
    held_out: bool
    duration_s: float
    readings: int
    """Number of readings of all joints together that the diagnosis uses."""
    truncated: bool = False
    """Whether the recording was interrupted or damaged."""


class Occupancy(Saved):
    """Time that a rod spent in each range of angle and speed."""

    angle_edges_rad: list[float]
    """Edges of the cells by angle over a full turn, rad: 0 is upright, pi is hanging."""
    speed_edges_rad_per_s: list[float]
    fitted_s: list[list[float]]
    """(angles, speeds) time in each cell over the fitted recordings, s."""
    held_out_s: list[list[float]]
    """(angles, speeds) time in each cell over the held-out recordings, s."""


class Closing(Saved):
    """Gap that remains after one more effect is added to the model."""

    effect: str
    """Name of the added effect; empty for the bare model."""
    left_rad: float
    """Remaining gap on held-out data: rms residual of a reading above the noise, rad."""
    closed: float
    """Share of the gap that all effects up to this one close."""


class Whiteness(Saved):
    """Statistics of the residuals of one joint under one model, in standard deviations of the noise."""

    autocorrelation: list[float]
    """Autocorrelation of the residuals at lag 0, 1, 2 and so on, in readings."""
    quantiles: list[float]
    """Quantiles of the residuals at `ResidualAnalysis.normal`."""
    beyond3: float
    """Share of the residuals beyond three standard deviations; 0.0027 for a normal distribution."""


class ResidualAnalysis(Saved):
    """Residual analysis of the fitted recordings, in segments with fitted initial states."""

    spacing_s: float
    """Time between neighbouring readings, s."""
    readings: int
    """Number of residuals of each joint."""
    normal: list[float]
    """Quantiles of the standard normal distribution, to which the residuals are compared."""
    joints: dict[str, dict[str, Whiteness]]
    """Residual analysis by joint, and by model: `before` and `after` the correction."""


DetectableSizes = Mapping[str, Mapping[str, float | None]]
"""Minimum detectable size, SI, by effect and amplitude; None if no size is detectable."""


@dataclass(frozen=True, slots=True)
class ExclusionLevels:
    """Minimum confidence with which an effect of its minimum detectable size is excluded."""

    sure: float = 0.95
    """Minimum confidence for an effect of known shape, whose estimate is then below 3.4 standard deviations."""
    of_shapes: float = 0.84
    """Minimum confidence for an effect of unknown shape.

    The largest estimate over all shapes is then below 4 standard deviations.
    """


EXCLUDED = ExclusionLevels()


class Exclusion(Saved):
    """Statement that an effect is smaller than a given size, with its confidence."""

    effect: str
    parameter: str
    size: float
    """Minimum detectable size of the amplitude, SI; without `L1_std` in the rig file, for exact L1 and g."""
    estimate: float
    """Estimate of the amplitude from these recordings, with all named effects in the model, SI."""
    confidence: float
    """Confidence that the effect is smaller than `size`, 0 to 1."""
    interval90: tuple[float, float] | None = None
    """90 % interval of the amplitude, fitted together with the other amplitudes, over all shapes of the effect.

    None if the recordings do not separate the amplitudes.
    """

    @property
    def is_excluded(self) -> bool:
        """Whether an equivalence test shows that the effect is smaller than `size`.

        An effect of known shape is excluded if its estimate is below 3.4 standard deviations. The estimate of an effect
        of unknown order, frequency or speed is the largest of several hundred estimates, and exceeds 3.4 by chance on
        one rig in four. Its limit is therefore 4. With the same confidence, a size of 5.6 instead of 5 standard
        deviations is then excluded.
        """
        return self.confidence >= self.sufficient

    @property
    def sufficient(self) -> float:
        """Minimum confidence with which the effect counts as excluded."""
        return EXCLUDED.of_shapes if EFFECTS[self.effect].shapes else EXCLUDED.sure


class WiderModel(Saved):
    """Fitted model with further effects that the recordings do not exclude."""

    effects: list[str]
    """The further effects."""
    probability: float | None = None
    """Posterior probability of the further effect; None for all common effects together."""
    intervals90: dict[str, tuple[float, float]]
    """90 % interval of each ratio, of a fitted b and of each fitted amplitude, such as `c1/b` or
    `coulomb_joint2.torque_Nm`; empty if the further effects are indistinguishable from the fitted values."""


class JointFriction(Saved):
    """Friction torque of a joint against its speed: viscous, named laws, and free-form curve."""

    speed_rad_per_s: list[float]
    """Speeds of the joint in both directions, ascending, rad/s.

    The joint reaches the largest of these speeds in both directions.
    """
    torque_Nm: list[float]
    """Friction torque at each speed, at the assumed b, N m; positive if it opposes a positive speed."""
    std_Nm: list[float]
    """Standard deviation of the friction torque at each speed, N m."""
    coefficients: int
    """Number of fitted values on which the friction torque depends."""
    back_emf: bool = False
    """Whether the torque contains the back-EMF of a voltage drive, which acts like viscous friction."""


class UncertaintySource(Saved):
    """One contribution to the uncertainty of a predicted angle."""

    name: str
    kind: Literal["numerical", "input", "data"]
    how: str
    """Origin of the contribution, and the assumed uncertainty."""
    left: float
    """Factor by which the recordings reduce the assumed uncertainty, because they would show a large error.

    The corrected model is assumed to be correct.
    """
    before_rad: float
    """Contribution to the standard uncertainty of the angles that the bare model predicts, rms, rad."""
    after_rad: float
    """Contribution to the standard uncertainty of the angles that the corrected model predicts, rms, rad."""


@dataclass(frozen=True, slots=True)
class FreeRunTest:
    """Limits of the test whether a free run shows a gap (decision 103)."""

    coverage: float = 4.0
    """Ratio of the error to its standard uncertainty above which a free run shows a gap.

    It is larger than the usual factor of two, because few uncertain quantities determine the error.
    """
    growth: float = 30.0
    """Maximum growth factor of an initial error in a tested free run. A larger one amplifies unknown small errors."""


FREE_RUN_TEST = FreeRunTest()


class RunBudget(Saved):
    """Error and uncertainty of one free run, both as rms over its compared part."""

    run: str
    held_out: bool
    until_s: float
    """End of the comparison, s after the first reading: the predictability horizon, or the end of the free run."""
    reaches_horizon: bool
    """Whether the comparison ends at the predictability horizon."""
    growth_per_s: float
    """Largest growth rate of an initial error of the angles until the end of the comparison, 1/s."""
    error_before_rad: float
    error_after_rad: float
    u_before_rad: float
    u_after_rad: float
    area_before_rad: float
    """Area between the distributions of the measured angles and of those that the bare model predicts, rad."""
    area_after_rad: float
    area_noise_rad: float
    """Area between two distributions of the angles that the corrected model predicts: without and with noise of the
    readings, rad."""

    @property
    def shows_gap(self) -> bool:
        """Whether the error of the bare model is far above its uncertainty (`FREE_RUN_TEST`)."""
        return self.error_before_rad > FREE_RUN_TEST.coverage * self.u_before_rad


class Budget(Saved):
    """Prediction errors of the free runs, and the uncertainty that a correct model would have."""

    sources: list[UncertaintySource]
    error_before_rad: float
    error_after_rad: float
    u_before_rad: float
    u_after_rad: float
    runs: list[RunBudget]

    @property
    def worst(self) -> RunBudget | None:
        """Predictable free run of the bare model with the largest ratio of error to uncertainty; None without one."""
        grown = math.log(FREE_RUN_TEST.growth)
        tested = [run for run in self.runs if run.u_before_rad > 0 and run.growth_per_s * run.until_s < grown]
        return max(tested, key=lambda run: run.error_before_rad / run.u_before_rad, default=None)


class Curves(Saved):
    """Measured curves of one recording, and free runs before and after correction."""

    run: str
    held_out: bool
    settled_s: float
    """End of the interval to which the initial state was fitted, s after the first reading."""
    until_s: float
    """Predictability horizon, or end of the free run, s after the first reading."""
    t_s: list[float]
    measured_rad: list[list[float]]
    """(n, 2) angles of the inner and outer rod, rad, 0 = upright."""
    before_rad: list[list[float]]
    after_rad: list[list[float]]
    rods: int = 2
    """Number of rods that swing separately. If it is 1, only the first angle has a meaning."""
    arm_rad: list[list[float]] = []
    """(n, 3) angle of an arm that is free or driven, rad: measured, before and after correction."""
    input: list[float] = []
    """(n,) input of the arm's drive, in the unit of `input_name`."""
    input_name: str = ""
    """Name of the input with its unit."""


class Evidence(Saved):
    """Evidence for a diagnosis."""

    version: str
    made_utc: str
    rig: str
    rig_sha256: str
    rig_values_sha256: str = ""
    """Hash of the values in the rig file, without poses, link and the setup of single recordings; empty in a file of
    an older version."""
    recordings: list[RecordingUsed]
    coverage: dict[str, Occupancy]
    """Time that a rod spent in each range of angle and speed, by rod."""
    closing: list[Closing]
    residuals: ResidualAnalysis
    exclusions: list[Exclusion]
    wider_models: list[WiderModel] = []
    """Models with further effects, for equivalence tests; empty in a file of an older version."""
    friction: dict[str, JointFriction] = {}
    """Friction torque by joint; empty in a file of an older version."""
    budget: Budget
    curves: list[Curves]
