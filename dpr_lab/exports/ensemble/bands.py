"""Compute predictive bands of an ensemble of models, and their coverage of recordings.

Each model starts from a random initial state, which is drawn from its distribution given the first readings. The model
then runs freely. Noise of the torque measurement is added to the known torques of driven joints. Noise of the encoders
is added to the simulated readings. The band at an instant lies between two quantiles over the models. Readings are not
compared if they were used for the initial states or are beyond the predictability horizon. At the beginning, a hand may
still move the rods. If the model follows the first half second much worse than later parts, the band therefore starts
at the first half second that the model follows.

An arm with rods soon moves chaotically. Its bands are therefore computed in windows. In each window, every model starts
from a random initial state, which is drawn from its distribution given the first readings of the window. The later
readings are compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.segments import Segments, segments
from dpr_lab.errors import RunError
from dpr_lab.exports.ensemble.starts import drawn_starts
from dpr_lab.exports.replay import ARM_REPLAY, arm_first, noise_of, run_problem
from dpr_lab.fitting.disturbance import torque_noise
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.identification.compare import Followed, follow, follow_preprocessed, free_run_from
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.engine import engine_constants, engine_values
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class BandSettings:
    """Settings of predictive bands."""

    level: float = 0.9
    """Share of the readings that a band should cover."""
    start_s: float = 0.5
    """Length of the interval of first readings to which an initial state is fitted, s."""
    starts: int = 4
    """Maximum number of instants, `start_s` apart, that are tried as the start of the band."""
    length_s: float = 10.0
    """Maximum duration of the comparison, s."""
    window_s: float = 1.5
    """Duration of a window of a moving arm, s."""
    rate_hz: float = 200.0
    """Rate of the compared readings, Hz."""
    unlike: float = 10.0
    """Factor for two limits on the rms misfit of a half second. The model follows the readings if the misfit is below
    this factor times the noise. Otherwise the misfit must at least be below this factor times the median over all half
    seconds."""
    unexplained: float = 0.5
    """Maximum unexplained share of the variance of the readings in a half second, if the model follows them."""


BANDS = BandSettings()


@dataclass(frozen=True, slots=True)
class PredictiveBand:
    """Predictive band of an ensemble for one recording."""

    run: str
    horizon_s: float
    """End of the comparison, s since the release. For a moving arm it is the end of the last window."""
    t: Array
    """(n,) times since the release, s."""
    measured: Array
    """(n, 2) readings, rad; (n, 3) for a moving arm, nan for joints without an encoder."""
    low: Array
    """Lower end of the band, in the shape of `measured`, rad."""
    high: Array
    """Upper end of the band, in the shape of `measured`, rad."""
    delay_s: float = 0.0
    """Time from the first reading to the first reading that is used for the initial states, s. The model does not
    follow the readings before it."""

    @property
    def readings(self) -> int:
        """Number of compared readings."""
        return int(np.isfinite(self.measured).sum())

    @property
    def covered(self) -> float:
        """Share of the compared readings inside the band, nan without readings."""
        inside = (self.measured >= self.low) & (self.measured <= self.high)
        return float(inside.sum()) / self.readings if self.readings else float("nan")

    @property
    def width_rad(self) -> float:
        """Mean width of the band, rad."""
        read = np.isfinite(self.measured)
        return float((self.high - self.low)[read].mean()) if read.any() else float("nan")


def predictive_band(model: Model, members: Sequence[Model], run: Run, rig: Rig, seed: int) -> PredictiveBand:
    """Compute the predictive band of an ensemble for one recording.

    Args:
        model: the corrected model, which determines start and horizon
        members: the ensemble
        run: the recording
        rig: rig of the recording
        seed: seed of initial states and noise

    Raises:
        RunError: the model cannot follow the readings.
    """
    rng = np.random.default_rng(seed)
    swing, followed = run.swing, follow(run, rig, model, BANDS.start_s)
    first, begin = float(swing.t[0]), _first_followed(followed)
    started = begin + BANDS.start_s
    end = min(free_run_from(followed, begin).horizon_s, begin + BANDS.length_s)
    stride = max(1, round((len(swing.t) - 1) / max(float(swing.t[-1]) - first, 1e-9) / BANDS.rate_hz))
    t = swing.t[(swing.t > started) & (swing.t <= end)][::stride]
    instants = swing.t[(swing.t >= begin) & (swing.t <= started)]
    of_start = (run.t < started + 1e-9) & ((run.t >= begin) | (begin == first))  # includes the rest before the release
    head = preprocess(run.only(of_start), rig)
    # Between instants the mean torques act; those of `head` end with its last instant.
    onward = segments([np.concatenate([instants, t])], setups=[swing.setup])
    noise_Nm = torque_noise(swing.setup.torques) if swing.setup.torques else np.zeros(2)
    drawn = []
    for member in members:
        if noise_Nm.any():
            noisy = _with_torque_noise(run, noise_Nm, rng)
            onward = replace(onward, setups=(noisy.swing.setup,))
            head = preprocess(noisy.only(of_start), rig)
        drawn.append(_swing(follow_preprocessed(head, rig, member), onward, rng)[len(instants) :])
    low, high = quantiles_of(np.array(drawn))
    measured = run.theta[np.searchsorted(run.t, t), 1:]
    return PredictiveBand(run.name, end, t, measured, low, high, begin - first)


def _first_followed(followed: Followed) -> float:
    """Return the start of the first segment that the model follows, s since the release.

    Raises:
        RunError: the model follows none of the first segments.
    """
    run, offsets = followed.preprocessed.run, followed.bare.problem.segments.offsets
    measured, noise = run.theta[:, 1:], np.diag(followed.preprocessed.noise.covariance)
    counts = np.diff(offsets)[:, None]
    misfits = np.add.reduceat((measured - followed.fitted.predicted) ** 2, offsets[:-1]) / counts
    usual = BANDS.unlike**2 * np.nanmedian(misfits, axis=0)
    tried = min(BANDS.starts, len(misfits))
    for k in range(tried):
        spread = np.var(measured[offsets[k] : offsets[k + 1]], axis=0)
        most = np.maximum(np.minimum(BANDS.unexplained * spread, usual), BANDS.unlike**2 * noise)
        if (misfits[k] < most).all():
            return float(run.t[offsets[k]])
    raise RunError(
        f"{run.file or run.name}: the model does not follow the first {tried * BANDS.start_s:g} s, so no band can"
        " start there. Either a hand still moved the rods, or the model lacks an effect: exclude this recording, or"
        " diagnose it"
    )


def quantiles_of(drawn: Array) -> tuple[Array, Array]:
    """Compute the lower and the upper bound (n, joints) of the readings (models, n, joints).

    Failed models are ignored. The k-th smallest value of m models is the quantile k / (m + 1) of the distribution from
    which the values are drawn (E. J. Gumbel 1958, Statistics of Extremes). The usual rule interpolates between the
    smallest and the largest value. With 50 models, the band would then cover 86 % instead of 90 %.
    """
    tail = (1 - BANDS.level) / 2
    finite = np.where(np.isfinite(drawn), drawn, np.nan)
    low, high = np.nanquantile(finite, [tail, 1 - tail], axis=0, method="weibull")
    return low, high


def level_of(models: int) -> float:
    """Return the share of readings that a band of m models is expected to cover.

    The share between the smallest and the largest of m values is (m - 1) / (m + 1): 67 % for five models, 90 % for 19.
    The band cannot cover more than this share.
    """
    return min(BANDS.level, (models - 1) / (models + 1))


def fewest_models() -> int:
    """Return the smallest number of models whose band can have the nominal coverage."""
    return round((1 + BANDS.level) / (1 - BANDS.level))


def _with_torque_noise(run: Run, std_Nm: Array, rng: np.random.Generator) -> Run:
    """Return a copy of a run with random torques: the measured torques minus random noise."""
    assert run.torques is not None
    return replace(run, torques=run.torques - std_Nm * rng.standard_normal(run.torques.shape))


def _swing(followed: Followed, onward: Segments, rng: np.random.Generator) -> Array:
    """Simulate the readings (n, 2) of one model in a free run, rad.

    The initial state is random, and noise is added to the readings.
    """
    problem = followed.fitted.problem
    started = drawn_starts(problem, followed.fitted.fit, rng)
    freely = replace(problem, segments=replace(onward, step=np.array([followed.step])))
    theta = problem.joints.to_rods(freely.predict(started.changed(initial=started.initial[:1])))
    noise = followed.preprocessed.noise.covariance
    return theta + rng.multivariate_normal(np.zeros(2), noise, len(theta), method="eigh")


def predictive_arm_band(members: Sequence[MovingArmModel], run: Run, rig: Rig, seed: int) -> PredictiveBand:
    """Compute the predictive band of an ensemble for one recording.

    Args:
        members: the ensemble
        run: the recording
        rig: rig of the recording
        seed: seed of initial states and noise

    Raises:
        RunError: the mode of the arm differs between run and models, or no model can follow the readings.
    """
    rng = np.random.default_rng(seed)
    problem, initial = run_problem(run, rig, members[0], BANDS.window_s)
    segments = problem.segments
    first = segments.t[segments.offsets[:-1]][problem.owner]
    head = segments.t < first + BANDS.start_s
    stride = max(1, round(1.0 / max(float(np.median(np.diff(segments.t))) * BANDS.rate_hz, 1e-9)))
    compared = ~head & (segments.t <= segments.t[0] + BANDS.length_s) & (np.arange(len(head)) % stride == 0)
    started = replace(problem, weight=np.where(head[:, None], problem.weight, 0.0))
    drawn = np.array([_readings(member, started, initial, rig, compared, rng) for member in members])
    drawn += np.nan_to_num(noise_of(problem)) * rng.standard_normal(drawn.shape)
    if not np.isfinite(drawn).all(axis=(1, 2)).any():
        raise RunError(f"{run.file or run.name}: no model of the ensemble can follow these readings")
    low, high = (np.roll(bound, 1, axis=1) for bound in quantiles_of(drawn))
    measured = arm_first(problem, problem.measured)[compared]
    t = segments.t[compared]
    return PredictiveBand(run.name, float(t[-1]) if len(t) else 0.0, t, measured, low, high)


def _readings(
    member: MovingArmModel,
    started: Problem,
    initial: Array,
    rig: Rig,
    compared: Flags,
    rng: np.random.Generator,
) -> Array:
    """Simulate the readings (n, 3) of one model from random initial states, without noise, rad."""
    problem = replace(started, model=RodsWithEffects(engine_constants(member, rig)))
    unknown, params = engine_values(member, rig)
    followed = fit(problem, Estimate.of(unknown, params, initial), (), iterations=ARM_REPLAY.iterations)
    return problem.predict(drawn_starts(problem, followed, rng))[compared]
