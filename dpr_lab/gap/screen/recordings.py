"""Screened recordings of one rig, and the fit problem of their segments."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.effect import Recorded
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.cut import cut
from dpr_lab.fitting.disturbance import disturbance
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.prior import Prior, prior_of
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.shutter import RollingShutter
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.identification.moving_arm.unknowns import arm_start
from dpr_lab.rig import MASSES, Rig


@dataclass(frozen=True, slots=True)
class SegmentLengths:
    """Lengths of the segments in the fits, s."""

    first: float = 0.25
    """Length in the first fit. With this length, the fit converges if the values of the rig file are within 20 % of the
    truth."""
    working: float = 0.5
    """Length at which effects are distinguished.

    The readings of such segments are four to seven times as sensitive to effects as those of the first segments, and
    Gauss-Newton still converges.
    """
    steady: float = 2.0
    """Maximum length for a single rod. Its motion is not chaotic, and the influence of friction accumulates over
    swings."""
    steady_parts: int = 5
    """Minimum number of segments in each recording of a single rod, from which their scatter is estimated."""
    growths: float = 7.0
    """Maximum length of the segments of a single driven rod, in units of sqrt(L1 / (1.5 g)).

    This unit is the time within which a deviation from upright, where a torque may keep the rod, grows by the factor e.
    """


LENGTHS = SegmentLengths()


@dataclass(frozen=True, slots=True)
class InitialGuess:
    """Settings of the estimate of initial states from neighbouring readings."""

    near_s: float = 0.03
    """Maximum time from the start of a segment to a reading that is used, s; a cubic polynomial fits any swing within
    it."""
    fewest: int = 6
    """Minimum number of readings for a cubic polynomial; with fewer readings within `near_s`, the next readings are
    used."""
    before: int = 4
    """Number of readings before the start of a segment that are used if fewer than `fewest` are within `near_s`."""


GUESS = InitialGuess()


@dataclass(frozen=True, slots=True)
class TrackingNoise:
    """Correlated errors of angles that were tracked in a video."""

    correlation: float
    """Autocorrelation of the errors of neighbouring readings."""
    factor: Array
    """(2,) standard deviation of the errors divided by that of their high-frequency part, for joints 1 and 2."""


@dataclass(frozen=True, slots=True)
class Recordings:
    """Preprocessed runs of a diagnosis, with their rig."""

    records: tuple[Record, ...]
    rig: Rig
    ratios: Array | None = None
    """(7,) ratios, b and p/b that determine the response of the rods to torque noise; None while they are unknown."""
    exact_torques: bool = False
    """Whether known torques are assumed to be exact."""
    torque_noise_Nm: tuple[float, float] = (np.inf, np.inf)
    """Upper limit of the standard deviation of the measured torques of joints 1 and 2, from a fit, N m."""
    tracking: TrackingNoise | None = None
    """Correlated errors estimated from a fit; None if the errors are white, or if their correlation was measured at
    rest."""
    shutter: RollingShutter | None = None
    """Rolling shutter for which the readings are corrected; None if no correction was made."""
    camera_rad: float = 0.0
    """Standard deviation of the rotation of the picture, rad; 0 for a fixed camera."""
    torques_earlier: float = 0.0
    """Time by which known torques act before their rows, as a share of the interval between rows.

    It is 0 if the torques are held from row to row, and one half for samples of a continuous signal.
    """

    @property
    def constants(self) -> RigConstants:
        """Measured constants of the rig."""
        return rig_constants(self.rig)

    @property
    def prior(self) -> Prior:
        """Prior of the ratios and of the sizes of effects, from the rig file."""
        return prior_of(self.rig)

    @property
    def masses_weighed(self) -> bool:
        """Whether all masses are measured, so that load-dependent friction determines the torque scale."""
        return all(self.rig.parameters[name].measured is not None for name in MASSES)

    @property
    def working_length(self) -> float:
        """Length of the segments at which effects are distinguished, s."""
        if not all(record.setup.alone and record.run.setup.arm is None for record in self.records) or self.arm_moves:
            return LENGTHS.working
        shortest = min((float(np.ptp(record.t)) for record in self.records), default=0.0)
        longest = LENGTHS.steady
        if any(record.setup.torques for record in self.records):
            longest = min(longest, LENGTHS.growths * float(np.sqrt(self.rig.L1 / (1.5 * self.rig.g))))
        return float(np.clip(shortest / LENGTHS.steady_parts, LENGTHS.working, max(longest, LENGTHS.working)))

    @property
    def arm_moves(self) -> bool:
        """Whether the arm of any run was free or driven."""
        return any(record.setup.arm_moves for record in self.records)

    @property
    def rods_length(self) -> float:
        """Length of the mounted rods, m."""
        return self.rig.L1 + (0.0 if all(record.setup.alone for record in self.records) else self.constants.L2)

    @property
    def of_points(self) -> bool:
        """Whether all angles come from points in a video, and not from encoder counts."""
        return all(record.run.film_noise is not None for record in self.records)

    @property
    def driven_arm(self) -> bool:
        """Whether a known input drove the arm of any run."""
        return any(record.setup.torques and record.setup.torques.on_arm is not None for record in self.records)

    @property
    def always(self) -> tuple[str, ...]:
        """Effects that are free in every fit: uncertain rig constants, moving arm, and gain of its drive."""
        unsure = [name for name, effect in EFFECTS.items() if effect.corrects in self.rig.unsure]
        arm = [FREE_ARM.name] if self.arm_moves else []
        gain = [DRIVE_GAIN.name] if self.driven_arm and not drive_gain(self.rig).known else []
        return (*unsure, *arm, *gain)

    @property
    def start_params(self) -> Array:
        """(SIZE,) initial parameters of effects; nonzero only for effects of a moving arm."""
        inertia, viscous = arm_start(self.rig)
        arm = {FREE_ARM.name: {"inertia_kgm2": inertia, "viscous_Nms": viscous}}
        return effect_params(arm if self.arm_moves else {})

    @property
    def may_be_films(self) -> bool:
        """Whether the readings of all recordings may come from videos."""
        return all(record.may_be_film for record in self.records)

    @property
    def properties(self) -> Recorded:
        """Properties of the recordings from which shapes of effects are proposed."""
        return Recorded(
            arm_moves=tuple(record.encoder0_moves for record in self.records),
            steps=[
                (axis, run, instant)
                for run, record in enumerate(self.records)
                for instant, axis in record.screened.breaks
            ],
        )

    def with_tracking_noise(self, noise: TrackingNoise | None) -> "Recordings":
        """Add correlated errors to the noise of films whose noise was not measured."""
        if noise is None or self.tracking is not None:
            return self
        evidence = (
            f"the residual of the bare model contains correlated errors of neighbouring readings (correlation"
            f" {noise.correlation:.2f}), probably of a tracker"
        )
        records = [
            record
            if record.noise_measured or not record.may_be_film
            else replace(
                record.with_finding("non_white_noise", evidence),
                sigma=record.sigma * noise.factor,
                noise_correlation=noise.correlation,
            )
            for record in self.records
        ]
        return replace(self, records=tuple(records), tracking=noise)

    def with_shutter(self, shutter: RollingShutter | None) -> "Recordings":
        """Correct the recordings for the rolling shutter of a camera.

        The readings are interpolated to the times of the frames.
        """
        if shutter is None:
            return self
        delay_ms = 1e3 * abs(shutter.delay_s_per_m) * self.rods_length
        evidence = (
            f"the sampling instants depend on the position in the image, as in a camera with a rolling shutter"
            f" ({shutter.lines} lines): {delay_ms:.2g} ms over the length of the rods; the readings are corrected"
        )
        records = [
            record.with_shutter(shutter, self.constants).with_finding("rolling_shutter", evidence)
            if record.may_be_film
            else record
            for record in self.records
        ]
        return replace(self, records=tuple(records), shutter=shutter)

    def with_camera(self, angle_rad: float) -> "Recordings":
        """Add a slow rotation of the picture to the noise of the recordings.

        `angle_rad` is the standard deviation of the rotation. The recordings do not change if it is zero, or if a
        recording is not a film.
        """
        if not angle_rad or not self.may_be_films:
            return self
        evidence = (
            f"the zero of the angles changes slowly, by {1e3 * angle_rad:.2g} mrad (standard deviation), as in a film"
            " from a camera that is not fixed; this change is treated as noise; fix the camera on a tripod for further"
            " films"
        )
        records = [record.with_finding("moving_camera", evidence) for record in self.records]
        return replace(self, records=tuple(records), camera_rad=angle_rad)

    def with_earlier_torques(self, share: float) -> "Recordings":
        """Move the known torques to earlier times, by a share of the interval between rows."""
        if not share:
            return self
        setups = [record.setup for record in self.records]
        earlier = [s if s.torques is None else replace(s, torques=s.torques.earlier(share)) for s in setups]
        records = [replace(record, setup=setup) for record, setup in zip(self.records, earlier, strict=True)]
        return replace(self, records=tuple(records), torques_earlier=share)

    def _widened(self, values: Array) -> Array:
        """Append a column of zeros to the (n, 2) values of a run with a clamped arm if the arm moves in another run."""
        missing = (3 if self.arm_moves else 2) - values.shape[1]
        return np.pad(values, ((0, 0), (0, missing))) if missing else values

    def cut(self, length: float) -> tuple[Problem, Array]:
        """Cut the recordings into segments of about the given length, s.

        Returns:
            the problem, and (segments, 4) initial states from the readings, or (segments, 6) if an arm moves
        """
        records = self.records
        cuts = [cut(record.t, length, record.breaks) for record in records]
        slices = [(i, s) for i, pieces in enumerate(cuts) for s in pieces]
        problem = Problem(
            segments=segments(
                [records[i].t[s] for i, s in slices],
                [i for i, _ in slices],
                [record.setup for record in records],
                [records[i].step for i, _ in slices],
            ),
            measured=np.concatenate([self._widened(records[i].joints[s]) for i, s in slices]),
            weight=np.concatenate([self._widened(1 / records[i].sigma[s]) for i, s in slices]),
            model=RodsWithEffects(self.constants),
            masses_weighed=self.masses_weighed,
            always=self.always,
            rezeroed=self.rig.encoders.rezeroed,
            prior=self.prior,
            noise_correlation=float(np.mean([record.noise_correlation for record in records])),
            camera_rad=self.camera_rad,
        )
        relative2 = self.rig.encoders.joint2 == "relative"
        states_of = _with_arm if self.arm_moves else _initial_states
        initial = np.concatenate(
            [states_of(recording, pieces, relative2) for recording, pieces in zip(records, cuts, strict=True)]
        )
        if self.ratios is not None:
            estimate = Estimate.of(self.ratios, self.start_params, initial)
            problem = replace(problem, disturbance=disturbance(problem, estimate, most_Nm=self.torque_noise_Nm))
        return problem, initial

    def without(self, problem: Problem, off: Flags) -> "Recordings":
        """Return the recordings without the readings that a (samples, 2) mask marks as faulty."""
        if not off.any():
            return self
        run = problem.segments.run[problem.owner]
        return replace(
            self,
            records=tuple(record.without(problem.t[run == i], off[run == i]) for i, record in enumerate(self.records)),
        )

    def only(self, chosen: Sequence[Record]) -> "Recordings":
        """Return a copy that contains the chosen runs of the same rig."""
        return replace(self, records=tuple(chosen))


def _initial_states(record: Record, slices: Sequence[slice], relative2: bool) -> Array:
    """Estimate (segments, states) initial states by cubics through the readings.

    At a release, the initial state is the mean reading at rest with zero speeds.

    Returns:
        theta1, theta2, omega1, omega2, and theta0, omega0 of a moving arm, rad and rad/s
    """
    begins = np.array([segment_start(float(record.t[s.start])) for s in slices])
    first, last = _near(record, np.array([s.start for s in slices], dtype=np.int64), begins)
    axes = record.joints.shape[1]
    states = np.empty((len(slices), 2 * axes))
    for size in np.unique(last - first):
        same_size = np.flatnonzero(last - first == size)
        windows = first[same_size, None] + np.arange(size)
        since_begin = record.t[windows] - begins[same_size, None]
        reach = np.abs(since_begin).max(axis=1)
        powers = (since_begin / reach[:, None])[:, :, None] ** np.arange(4)
        across = powers.transpose(0, 2, 1)
        cubic = np.linalg.solve(across @ powers, across @ record.joints[windows])
        angles, speeds = cubic[:, 0], cubic[:, 1] / reach[:, None]
        states[same_size, :2], states[same_size, 2:4] = angles[:, :2], speeds[:, :2]
        if axes > 2:
            states[same_size, 4], states[same_size, 5] = angles[:, 2], speeds[:, 2]
    states[:, [1, 3]] += float(relative2) * states[:, [0, 2]]
    if len(record.run.rest):
        arm = [record.run.rest[:, 0].mean(), 0.0] if axes > 2 else []
        states[begins == 0.0] = [*record.run.rest[:, 1:].mean(axis=0), 0.0, 0.0, *arm]
    return states


def _with_arm(record: Record, slices: Sequence[slice], relative2: bool) -> Array:
    """Return (segments, 6) initial states; theta0 and omega0 of the arm come last.

    A clamped arm rests at its mean angle.
    """
    states = _initial_states(record, slices, relative2)
    if record.setup.arm_moves:
        return states
    held = float(np.mean(record.run.swing.theta[:, 0]))
    return np.column_stack([states, np.full(len(states), held), np.zeros(len(states))])


def _near(record: Record, starts: Integers, begins: Array) -> tuple[Integers, Integers]:
    """Return the range of the readings near each instant; the range does not extend across an interruption.

    If it contains fewer than `GUESS.fewest` readings, it is extended to neighbours of the first reading of the segment.

    Args:
        record: the run
        starts: (n,) indices of the first readings of segments
        begins: (n,) instants at which the segments start, s

    Returns:
        (n,) index of the first reading, and (n,) index after the last reading
    """
    edges = np.array([-np.inf, *record.breaks, np.inf])
    part = np.searchsorted(record.breaks, record.t[starts], side="right")
    first, last = (np.searchsorted(record.t, edges[side]) for side in (part, part + 1))
    i = np.maximum(first, np.searchsorted(record.t, begins - GUESS.near_s, side="right"))
    j = np.minimum(last, np.searchsorted(record.t, begins + GUESS.near_s))
    sparse = j - i < GUESS.fewest
    i = np.where(sparse, np.maximum(first, starts - GUESS.before), i)
    return i, np.where(sparse, np.minimum(last, starts + GUESS.fewest), j)
