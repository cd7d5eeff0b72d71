"""Blind trials on simulated plants that resemble one rig.

A plant is the corrected model of the rig with the named effects, with another effect, or without effects. It is
recorded at the times of the recordings of the rig, with new random noise. dpr-lab simulates the readings with a quarter
of the integration step of the fits. The trials show how reliable the named effects are for this rig, these recordings
and this noise. They do not cover effects outside the library. (`dpr-lab trials` uses plants of an independent
simulation program.)
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.child_process import worker_pool
from dpr_lab.dynamics.prediction import predict, segment_start
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import STEP, segments
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.effect import Effect, Params
from dpr_lab.errors import DprError
from dpr_lab.fitting.estimate import Estimate, whole_of
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.trust import NOTHING, REFUSED, ConfusionCell, Trust, TrustShare, TrustTrial
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.sensor_faults import Screened
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.trials.summary import wilson90

Effects = Mapping[str, Params]


@dataclass(frozen=True, slots=True)
class OwnRigSettings:
    """Settings of the plants: hidden effects and simulation."""

    times_detectable: tuple[float, float] = (2.0, 20.0)
    """Range of the sizes of drawn effects, relative to the minimum detectable size.

    The logarithm of the size is distributed uniformly.
    """
    finer: float = 4.0
    """Factor by which the integration step of a plant is smaller than the step of the fits."""
    kinds: tuple[str, ...] = ("as found", "another", "another", "clean")
    """Kinds of plants, which successive trials use in turn."""


OWN_RIG = OwnRigSettings()


@dataclass(frozen=True, slots=True)
class _Original:
    """A recording of the rig, and the initial state from which the plants are simulated."""

    run: Run
    seen: Screened
    start: Array
    """(1, 4) initial state."""
    start_s: float


def trust(
    diagnosis: Diagnosis,
    runs: Sequence[Run],
    rig: Rig,
    count: int,
    *,
    library: Mapping[str, Effect] = EFFECTS,
    max_effects: int = 4,
    seed: int = 0,
    processes: int = 1,
    on_trial: Callable[[int], None] = lambda done: None,
) -> Trust:
    """Estimate the reliability of a diagnosis by blind trials on simulated plants.

    Args:
        diagnosis: the diagnosis of the rig
        runs: the diagnosed runs, without held-out runs
        rig: the rig
        count: number of trials
        library: the candidate effects
        max_effects: maximum number of effects in a diagnosis
        seed: seed of plants and noise
        processes: number of trials in parallel; if it is 1, the trials run in this process
        on_trial: function that is called before the first trial and after each trial with the number of finished trials

    Raises:
        DprError: a process was killed.
    """
    estimate = Estimate.of(diagnosis.unknowns, effect_params(diagnosis.model_effects), np.zeros((0, 4)))
    originals = tuple(_original(run, rig, estimate) for run in runs)
    plan = _Plan(diagnosis, originals, rig, tuple(library), max_effects, seed)
    trials: dict[int, TrustTrial] = {}
    on_trial(0)
    for number, trial in _made(plan, count, min(processes, count)):
        trials[number] = trial
        on_trial(len(trials))
    return _summed([trials[number] for number in range(count)], seed)


@dataclass(frozen=True, slots=True)
class _Plan:
    """Data that all trials share. A call with the number of a trial runs this trial, in any process."""

    diagnosis: Diagnosis
    originals: tuple[_Original, ...]
    rig: Rig
    library: tuple[str, ...]
    """Names of the candidate effects. The effects contain compiled kernels, which cannot be sent to a process."""
    max_effects: int
    seed: int

    def __call__(self, number: int) -> TrustTrial:
        diagnosis, rig = self.diagnosis, self.rig
        rng, began = np.random.default_rng([self.seed, number]), time.perf_counter()
        library = {name: EFFECTS[name] for name in self.library}
        kind = OWN_RIG.kinds[number % len(OWN_RIG.kinds)]
        truth = {"as found": _as_found(diagnosis), "clean": {}}.get(kind)
        arm_moves = any(original.run.setup.arm_moves for original in self.originals)
        acting = {name: effect for name, effect in library.items() if arm_moves or not effect.of_arm}
        truth = _another(diagnosis, acting, rng) if truth is None else truth
        params = effect_params(truth)
        recorded = [_recorded_again(original, rig, diagnosis.unknowns, params, rng) for original in self.originals]
        options = {"library": library, "max_effects": self.max_effects, "start": diagnosis.unknowns, "seed": self.seed}
        try:
            diagnosis = diagnose(recorded, rig, **options)
        except DprError:  # if a diagnosis fails for one plant, the other trials still count
            diagnosis = None
        return _judged(kind if truth else "clean", truth, diagnosis, time.perf_counter() - began)


def _made(trial: Callable[[int], TrustTrial], count: int, processes: int) -> Iterator[tuple[int, TrustTrial]]:
    """Run trials in one or several processes; yield each one with its number."""
    if processes < 2:
        yield from ((number, trial(number)) for number in range(count))
        return
    try:
        with worker_pool(processes) as pool:
            numbers = {pool.submit(trial, number): number for number in range(count)}
            for done in as_completed(numbers):
                yield numbers[done], done.result()
    except BrokenProcessPool as error:
        raise DprError(
            "a process of --trust was killed (out of memory?); the diagnosis is kept if --out was given"
        ) from error


def _as_found(diagnosis: Diagnosis) -> Effects:
    named = {effect.name for effect in diagnosis.effects}
    return {name: values for name, values in diagnosis.model_effects.items() if name in named}


def _original(run: Run, rig: Rig, estimate: Estimate) -> _Original:
    prepared = record(run, rig)
    freely = free_runs(Recordings((prepared,), rig), estimate)
    return _Original(run, prepared.screened, freely.start.initial, segment_start(float(freely.records[0].t[0])))


def _another(diagnosis: Diagnosis, library: Mapping[str, Effect], rng: np.random.Generator) -> Effects:
    """Draw an effect that the diagnosis does not name, with a random detectable size."""
    named = {effect.name for effect in diagnosis.effects}
    detectable = {name: {k: v for k, v in sizes.items() if v} for name, sizes in diagnosis.detectable.items()}
    names = [n for n in detectable if n in library and n not in named and detectable[n] and not library[n].event]
    if not names:
        return {}
    effect = library[names[rng.integers(len(names))]]
    amplitudes = [parameter for parameter in effect.amplitudes if parameter.name in detectable[effect.name]]
    chosen = amplitudes[rng.integers(len(amplitudes))]
    low, high = np.log(OWN_RIG.times_detectable)
    size = (detectable[effect.name][chosen.name] or 0.0) * float(np.exp(rng.uniform(low, high)))
    sign = 1.0 if chosen.sign == "positive" else float(rng.choice([-1.0, 1.0]))
    return {effect.name: {chosen.name: sign * size}}


def _recorded_again(original: _Original, rig: Rig, ratios: Array, params: Array, rng: np.random.Generator) -> Run:
    """Return the recording with simulated readings of a plant; readings before the release are not changed."""
    run, screened = original.run, original.seen
    swing = run.t > original.start_s
    finer = segments([run.t[swing]], setups=[run.setup], step=STEP / OWN_RIG.finer)
    joints = predict(whole_of(ratios), params, rig_constants(rig), finer, original.start)
    rounding = np.where(screened.count > 0, screened.count, 0.0) / np.sqrt(12)
    noise = np.sqrt(np.maximum(np.where(np.isfinite(screened.noise), screened.noise, 0.0) ** 2 - rounding**2, 0.0))
    joints += noise * rng.standard_normal(joints.shape)
    counts = None
    if run.counts is not None:
        counts = run.counts.copy()
        step = rig.radians_per_count[1:]
        was = rig.encoders.joint_angles.of_rods(run.theta[swing, 1:])
        steps = np.maximum(np.rint(screened.count / np.abs(step)), 1)
        counts[swing, 1:] += (steps * np.rint((joints - was) / (steps * step))).astype(np.int64)
        joints = was + (counts[swing, 1:] - run.counts[swing, 1:]) * step
    theta = run.theta.copy()
    theta[swing, 1:] = rig.encoders.joint_angles.to_rods(joints)
    if run.mounting in ("inner", "outer"):
        theta[swing, 2] = theta[swing, 1]
    return replace(run, theta=theta, counts=counts, file=None, sha256="")


def _judged(kind: str, truth: Effects, diagnosis: Diagnosis | None, seconds: float) -> TrustTrial:
    effects = diagnosis.effects if diagnosis else []
    right = [name for name in truth if any(name in (effect.name, *effect.members) for effect in effects)]
    wrong = [effect.name for effect in effects if not {effect.name, *effect.members} & set(truth)]
    return TrustTrial.model_validate(
        {
            "kind": kind,
            "truth": truth,
            "named": [effect.name for effect in effects],
            "verdict": diagnosis.verdict if diagnosis else REFUSED,
            "right": right,
            "wrong": wrong,
            "seconds": seconds,
        }
    )


def _summed(trials: Sequence[TrustTrial], seed: int) -> Trust:
    hidden, clean = ([trial for trial in trials if bool(trial.truth) is has_effect] for has_effect in (True, False))
    cells = Counter(cell for trial in trials for cell in _cells(trial))
    return Trust(
        seed=seed,
        seconds_each=float(np.median([trial.seconds for trial in trials])) if trials else 0.0,
        trials=list(trials),
        confusion=[ConfusionCell(true=true, named=named, trials=n) for (true, named), n in sorted(cells.items())],
        right=_share([set(trial.right) == set(trial.truth) and not trial.wrong for trial in hidden]),
        wrong=_share([bool(trial.wrong) for trial in hidden]),
        false_alarms=_share([bool(trial.named) for trial in clean]),
    )


def _cells(trial: TrustTrial) -> list[tuple[str, str]]:
    """Return the cells of the confusion table as pairs (true, named).

    A correctly named effect is paired with itself. Missed effects are paired with the wrongly named ones. A missing
    partner is `NOTHING`.
    """
    missed = [name for name in trial.truth if name not in trial.right]
    count = max(len(missed), len(trial.wrong))
    pairs = zip(
        missed + [NOTHING] * (count - len(missed)), trial.wrong + [NOTHING] * (count - len(trial.wrong)), strict=True
    )
    cells = [*((name, name) for name in trial.right), *pairs]
    return cells or [(NOTHING, NOTHING)]


def _share(held: Sequence[bool]) -> TrustShare:
    interval = wilson90(sum(held), len(held)) if held else (0.0, 1.0)
    return TrustShare(held=sum(held), of=len(held), interval90=interval)
