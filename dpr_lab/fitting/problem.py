"""Fit problem: encoder readings of segments, their weights, and the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers, row_sums
from dpr_lab.dynamics.segments import Segments
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.estimate import ZEROS_BEGIN, Estimate, FreeParameter, zero_parameters
from dpr_lab.fitting.whitening import Disturbance, innovations, padded, turned_picture
from dpr_lab.joint_angles import JointAngles

if TYPE_CHECKING:
    from dpr_lab.fitting.prior import Prior


class OutputModel(Protocol):
    """Dataclass that predicts encoder readings along segments, and their derivatives."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def constants(self) -> RigConstants:
        """Measured constants of the rig."""
        ...

    def predict(self, segments: Segments, estimate: Estimate) -> Array:
        """Return the (samples, 2) readings of the encoders of joints 1 and 2, rad.

        The readings are not finite if the integration fails.
        """
        ...

    def slopes(
        self,
        segments: Segments,
        estimate: Estimate,
        free: Sequence[FreeParameter],
        predicted: Array | None = None,
    ) -> Array:
        """Return the (samples, 2, free + 4) derivatives of the readings.

        The last four derivatives are those with respect to the initial state of the segment. `predicted` contains the
        readings at the estimate, if they are known. A model that computes derivatives less accurately compares its own
        readings with `predicted`.
        """
        ...


@dataclass(frozen=True, slots=True)
class Problem:
    """Fit problem: the segments of all runs, their readings and weights, and the model.

    Whitened values are padded to one length: row 2 k + j of a segment is its sample k of joint j + 1. If the arm of any
    run moves, the arm is a third axis, and its angle and speed are components five and six of an initial state.
    """

    segments: Segments
    measured: Array
    """(samples, 2) encoder readings, rad."""
    weight: Array
    """(samples, 2) reciprocal standard deviation of each reading times the square root of a robust weight, 1/rad."""
    model: OutputModel
    masses_weighed: bool = False
    """Whether the masses of the rig were measured; load-dependent friction then determines the scale of torques."""

    always: tuple[str, ...] = ()
    """Effects that are free in every fit.

    Each corrects a quantity whose uncertainty the rig file states.
    """
    noise_correlation: float = 0.0
    """Correlation of the noise of neighbouring readings, due to a filter or a tracker."""
    rezeroed: bool = False
    """Whether the encoders are zeroed before each run; every fit then estimates the zeros of each run."""
    prior: "Prior | None" = None
    """Prior information of the rig file; None for a fit to the readings alone."""
    disturbance: Disturbance | None = None
    """Process noise of known torques and arm motions in these segments; None for free swings."""
    camera_rad: float = 0.0
    """Standard deviation of the angle of the picture in a film of free swings, rad; 0 for a fixed camera."""

    @property
    def t(self) -> Array:
        """(samples,) time since the release, s."""
        return self.segments.t

    @property
    def read(self) -> Flags:
        """(samples, 2) mask of the used readings."""
        return self.weight > 0.0

    @property
    def axes(self) -> int:
        """Number of encoders: 2, or 3 with the encoder of an arm that moves."""
        return self.measured.shape[1]

    @property
    def limits(self) -> Array | None:
        """(SIZE,) maximum sizes of amplitudes of effects, or None if there is no prior."""
        return None if self.prior is None else self.prior.limits

    @property
    def evidence(self) -> int:
        """Degrees of freedom: number of readings minus number of initial values."""
        return int(np.count_nonzero(self.read) - self.segments.initial_values.sum())

    @property
    def evidence_by_segment(self) -> Integers:
        """(segments,) degrees of freedom of each segment."""
        readings = np.count_nonzero(self.read, axis=1)
        return np.add.reduceat(readings, self.segments.offsets[:-1]) - self.segments.initial_values

    @property
    def joints(self) -> JointAngles:
        """Map from the angles of the rods to the encoder readings."""
        return JointAngles(self.model.constants.relative2 == 1.0)

    @property
    def owner(self) -> Integers:
        """(samples,) index of the segment of each sample."""
        return self.segments.owner

    def whitened(self, values: Array) -> Array:
        """Weight values (samples, 2[, k]) and arrange them by segment, (segments, m[, k]).

        With process noise, the results are innovations, which are independent and have unit variance. The slow rotation
        of a picture is part of the noise.
        """
        columns = values.reshape(*self.weight.shape, -1)
        blocks = self.decorrelated(padded(columns, self.weight, self.segments.offsets))
        return blocks.reshape(*blocks.shape[:2], *values.shape[2:])

    def decorrelated(self, weighed: Array) -> Array:
        """Convert weighted, padded values (segments, longest, 2, k) to whitened values (segments, m, k).

        The conversion is in place.
        """
        if (noise := self.disturbance) is not None:
            innovations(weighed, self.weight, self.segments.offsets, noise.walk, noise.out, noise.shared)
        values = weighed.reshape(len(weighed), -1, weighed.shape[3])
        if self.camera_rad:
            U, sizes = self._turned_picture()
            removed = 1 - (1 + (self.camera_rad * sizes) ** 2) ** -0.5
            with np.errstate(invalid="ignore", over="ignore"):
                values -= U @ (removed[:, :, None] * (U.transpose(0, 2, 1) @ values))
        return values

    def _turned_picture(self) -> tuple[Array, Array]:
        turned = self.joints.of_rods(np.ones((1, 2)))[0]
        return turned_picture(self.t, turned, self.weight, self.segments.offsets)

    @property
    def log_variance(self) -> float:
        """Logarithm of the determinant of the covariance of the weighted readings."""
        if self.camera_rad:
            return float(np.log1p((self.camera_rad * self._turned_picture()[1]) ** 2).sum())
        if (noise := self.disturbance) is None:
            return 0.0
        zeros = padded(np.zeros((len(self.t), self.axes, 1)), self.weight, self.segments.offsets)
        return innovations(zeros, self.weight, self.segments.offsets, noise.walk, noise.out, noise.shared)

    def by_sample(self, whitened: Array) -> Array:
        """Rearrange whitened values by segment, (segments, m), to values by sample, (samples, 2)."""
        owner = self.owner
        row = np.arange(len(owner)) - self.segments.offsets[owner]
        return whitened.reshape(len(whitened), -1, self.axes)[owner, row]

    def with_zeros(self, estimate: Estimate) -> Estimate:
        """Return the estimate with encoder zeros for each run if the zeros are free.

        Zeros are set to 0 unless the estimate contains those of all runs.
        """
        runs = len(self.segments.setups)
        return (
            estimate.changed(zeros=np.zeros((runs, 2))) if self.rezeroed and len(estimate.zeros) != runs else estimate
        )

    def all_free(self, free: Sequence[FreeParameter]) -> tuple[FreeParameter, ...]:
        """Return all unknowns except the initial states.

        If the zeros of the encoders are free, the zeros of each run are included.
        """
        zeros = zero_parameters(self.segments.setups) if self.rezeroed else ()
        return (*free, *(parameter for parameter in zeros if parameter not in free))

    def predict(self, estimate: Estimate) -> Array:
        """Return the (samples, 2) predicted readings, rad."""
        return self.model.predict(self.segments, estimate) + self._zeros(estimate)

    def _zeros(self, estimate: Estimate) -> Array | float:
        """Return the (samples, 2) encoder zeros, rad, that apply to the run of each sample.

        The result is the number 0 if no zeros are free.
        """
        if not len(estimate.zeros):
            return 0.0
        zeros = np.zeros((len(estimate.zeros), self.axes))
        zeros[:, :2] = estimate.zeros
        return zeros.take(self.segments.run[self.owner], axis=0)

    def slopes(self, estimate: Estimate, free: Sequence[FreeParameter], predicted: Array | None = None) -> Array:
        """Return the (samples, 2, free + 4) derivatives of the predicted readings.

        The last four derivatives are those with respect to the initial state. If `predicted`, (samples, 2), is given,
        the model checks the accuracy of its derivatives (`OutputModel.slopes`).
        """
        zeros = [i for i, parameter in enumerate(free) if parameter.block == "zeros"]
        of_rods = None if predicted is None else predicted - self._zeros(estimate)
        of_model = self.model.slopes(self.segments, estimate, [p for p in free if p.block != "zeros"], of_rods)
        if not zeros:
            return of_model
        run = self.segments.run[self.owner]
        slopes = np.zeros((len(free) + self.segments.states, *of_model.shape[:2]))
        slopes[np.delete(np.arange(len(slopes)), zeros)] = np.moveaxis(of_model, -1, 0)
        for i in zeros:
            of_run, joint = divmod(free[i].place - ZEROS_BEGIN, 2)
            slopes[i, run == of_run, joint] = 1.0
        return np.moveaxis(slopes, 0, -1)

    def chi2_by_segment(self, predicted: Array) -> Array:
        """Return the (segments,) sum of squared whitened residuals; inf after a failed simulation."""
        with np.errstate(over="ignore", invalid="ignore"):
            if self.disturbance is not None or self.camera_rad:
                return np.nan_to_num(np.sum(self.whitened(self.measured - predicted) ** 2, axis=1), nan=np.inf)
            squares = row_sums(((self.measured - predicted) * self.weight) ** 2)
        return np.nan_to_num(np.add.reduceat(squares, self.segments.offsets[:-1]), nan=np.inf)

    def prior_weight(self, chi2_by_segment: Array) -> float:
        """Return the weight of the prior, max(1, reduced chi2).

        A residual above the noise is thereby treated as noise of its size.
        """
        return max(1.0, float(chi2_by_segment[np.isfinite(chi2_by_segment)].sum()) / max(self.evidence, 1))

    def chi2(self, estimate: Estimate) -> float:
        """Return the sum of squared whitened residuals of all segments."""
        return float(self.chi2_by_segment(self.predict(estimate)).sum())

    def with_constants(self, constants: RigConstants) -> Self:
        """Return a copy whose model has other measured constants of the rig."""
        return replace(self, model=replace(self.model, constants=constants))

    def with_half_steps(self) -> Self:
        """Return a copy with half the steps of the integrator."""
        return replace(self, segments=replace(self.segments, step=self.segments.step / 2))

    def weighted(self, factor: Array) -> "Problem":
        """Return a copy with every weight multiplied by `factor` (samples, 1 or 2)."""
        return replace(self, weight=self.weight * factor)
