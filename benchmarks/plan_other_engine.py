"""Number of releases needed to decide the cause on plants in MuJoCo: by plan, by a fixed menu, and at random.

    python benchmarks/plan_other_engine.py --plants 10

A plant is drawn near the rig `paper`. It has no effect, or one effect of one to ten times the smallest size that the
average release of the menu shows. Releases of each plant are recorded until its cause is decided, or until only a bench
check can decide, as in `dpr-lab trials campaign --plan`. A plant that stays undecided counts as one release more than
the maximum.

`--first N` estimates the minimum for each plant. If no strategy decides the cause with one release, N other first
releases are recorded and diagnosed one by one. If one of them decides, the minimum is one; otherwise it is the smallest
number of all strategies.

No strategy can need fewer releases than one for a plant with an effect, and the number that "no gap" requires for a
plant without one. The quotient of their sum and the menu's number of releases bounds the result from below.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from _bars import Bar, at_least, at_most, options, show
from _random_rigs import PLACEMENT_STD, WITHIN
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.planning.candidates import minutes
from dpr_lab.planning.information import informed
from dpr_lab.planning.knowledge import known_before
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.stopping import STOPPING
from dpr_lab.planning.worth.criteria import detectable
from dpr_lab.rig import MASSES, PARAMETERS, Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.trials.next_release import SEQUENTIAL, STRATEGIES, at_random, limits_of
from dpr_lab.trials.sequential import SequentialLook, played
from dpr_lab.trials.sequential_summary import forecast_claims
from dpr_lab.trials.summary import calibration_error, error_if_exact

mujoco: Any = import_module("mujoco")  # its stubs are incomplete

Array = NDArray[np.float64]

STEP_S = 5e-4
REST_S = 0.5
FACTOR = (1.0, 10.0)
"""Range of the size of an effect, in units of the smallest size that the average release of the menu shows."""

RODS = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step!r}" integrator="RK4" gravity="{across!r} 0 {down!r}"/>
  <worldbody><body>
    <joint type="hinge" axis="0 1 0" damping="{c1!r}" stiffness="{k1!r}" springref="{pi!r}"/>
    <inertial pos="0 0 {l1!r}" mass="{m1!r}" diaginertia="{J1!r} {J1!r} 1e-9"/>
    <body pos="0 0 {L1!r}"><inertial pos="0 0 0" mass="{mb!r}" diaginertia="1e-12 1e-12 1e-12"/></body>
    <body pos="0 0 {L1!r}">
      <joint type="hinge" axis="0 1 0" damping="{c2!r}" stiffness="{k2!r}" armature="{rotor!r}"/>
      <inertial pos="{offset!r} 0 {l2!r}" mass="{m2!r}" diaginertia="{J2!r} {J2!r} 1e-9"/>
    </body>
  </body></worldbody>
</mujoco>
"""

AMPLITUDES = {
    "spring_joint1": "stiffness_Nm_per_rad",
    "spring_joint2": "stiffness_Nm_per_rad",
    "rotor_inertia_joint2": "inertia_kgm2",
    "base_tilt": "tilt_rad",
    "com_offset_link2": "offset_m",
    "encoder_scale_joint1": "excess",
    "encoder_scale_joint2": "excess",
    "latency_joint2": "delay_s",
}
"""Amplitude that is drawn, by effect."""


@dataclass(frozen=True, slots=True)
class Plant:
    """A plant in MuJoCo with its hidden effect."""

    Z: Array
    """(9,) true parameters, SI units."""
    effect: str
    """Name of the hidden effect; empty without one."""
    size: float
    rig: Rig
    """Rig file, whose masses are accurate to 0.1 %."""
    others: Mapping[str, float] = field(default_factory=dict)
    """Sizes of further effects."""

    @property
    def sizes(self) -> dict[str, float]:
        """Size of every effect in `AMPLITUDES`; zero for an absent effect."""
        return {name: self.others.get(name, self.size * (name == self.effect)) for name in AMPLITUDES}

    def model(self) -> Any:
        """Compiled model with the effects that act on the rods."""
        size = self.sizes
        values = dict(zip(PARAMETERS, self.Z.tolist(), strict=True))
        text = RODS.format(
            **values,
            step=STEP_S,
            L1=self.rig.L1,
            pi=np.pi,
            across=self.rig.g * float(np.sin(size["base_tilt"])),
            down=-self.rig.g * float(np.cos(size["base_tilt"])),
            k1=size["spring_joint1"],
            k2=size["spring_joint2"],
            rotor=size["rotor_inertia_joint2"],
            offset=size["com_offset_link2"],
        )
        return mujoco.MjModel.from_xml_string(text)

    def swing(self, start: Array, t: Array) -> Array:
        """(n, 2) absolute angles of the rods at evenly spaced instants, rad, from rest."""
        model = self.model()
        data, substeps = mujoco.MjData(model), round((t[1] - t[0]) / STEP_S)
        data.qpos[:] = start[0], start[1] - start[0]
        theta = np.empty((len(t), 2))
        for i in range(len(t)):
            theta[i] = data.qpos[0], data.qpos.sum()
            for _ in range(substeps):
                mujoco.mj_step(model, data)
        return theta

    def record(self, release: CandidateRelease, rng: np.random.Generator) -> Run:
        """Record a release by hand, in counts."""
        rate, encoders = self.rig.link.rate_hz, self.rig.encoders
        t = np.arange(-round(REST_S * rate), round(release.duration_s * rate) + 1) / rate
        start = np.array([release.theta1, release.theta2]) + rng.normal(0, PLACEMENT_STD, 2)
        theta = np.zeros((len(t), 3))
        theta[t < 0, 1:] = start
        theta[t >= 0, 1:] = self.swing(start, t[t >= 0])
        positions = self.rig.positions(self._misread(t, theta)) + rng.normal(0, encoders.noise_counts, theta.shape)
        counts = np.rint(positions).astype(np.int64)
        return Run("release", t, self.rig.theta(counts), counts, "release", self.rig.name, "", rate)

    def _misread(self, t: Array, theta: Array) -> Array:
        """Angles with the errors of the encoders."""
        size, bend = self.sizes, theta[:, 2] - theta[:, 1]
        if delay := size["latency_joint2"]:
            bend = CubicSpline(t, bend)(np.maximum(t - delay, t[0]))
        read = theta.copy()
        read[:, 1] += size["encoder_scale_joint1"] * (theta[:, 1] - np.pi)
        read[:, 2] = read[:, 1] + (1.0 + size["encoder_scale_joint2"]) * bend
        return read


def near_paper(rng: np.random.Generator) -> tuple[Array, Rig]:
    """Random parameters near those of the rig `paper`, (9,) SI, and the rig file of this plant."""
    paper = load_rig("paper")
    Z = paper.nominal * rng.uniform(1 - WITHIN, 1 + WITHIN, len(PARAMETERS))
    described = paper.model_dump(exclude_none=True)
    for name, value in zip(PARAMETERS, Z.tolist(), strict=True):
        if name in MASSES:
            described["parameters"][name].update(measured=value, std=1e-3 * value)
    rig = Rig.model_validate(described)
    assert rig.encoders.joint2 == "relative", "the encoder errors of this file are those of a relative encoder 2"
    return Z, rig


def drawn(seed: int) -> Plant:
    """Draw a random plant. Every fifth plant has no effect."""
    rng = np.random.default_rng([seed, 28])
    Z, rig = near_paper(rng)
    if seed % 5 == 4:
        return Plant(Z, "", 0.0, rig)
    effect = str(rng.choice(list(AMPLITUDES)))
    known, duration = known_before(rig), SEQUENTIAL.duration_s
    menu = [CandidateRelease(pose.theta1, pose.theta2, duration) for pose in rig.poses.values()]
    H = np.mean([release.information for release in informed(menu, known.model)], axis=0)
    smallest = detectable(known, known.prior + H, SIGMAS, [effect])[effect][AMPLITUDES[effect]]
    assert smallest is not None, effect
    return Plant(Z, effect, smallest * float(np.exp(rng.uniform(*np.log(FACTOR)))), rig)


def is_right(plant: Plant, looks: Sequence[SequentialLook]) -> bool:
    """Whether the last diagnosis names the effect or its class, or no effect on a plant without an effect."""
    effects = looks[-1].diagnosis.effects
    names = {name for effect in effects for name in (effect.name, *effect.members)}
    return plant.effect in names if plant.effect else not effects


def is_true(plant: Plant, looks: Sequence[SequentialLook]) -> bool:
    """Whether the last diagnosis is right, or reports no gap and a minimum detectable size above the effect."""
    diagnosis = looks[-1].diagnosis
    least = diagnosis.detectable.get(plant.effect, {}).get(AMPLITUDES.get(plant.effect, ""))
    return is_right(plant, looks) or (diagnosis.verdict == "no_gap" and least is not None and plant.size < least)


def least(plant: Plant, counts: Mapping[str, int], first: int, seed: int) -> int:
    """Smallest number of releases that decides a plant, over all strategies and some other first releases.

    Args:
        plant: the plant
        counts: number of releases of each strategy
        first: number of other first releases, at random poses
        seed: seed of the plant
    """
    decided = min(counts.values())
    if not plant.effect or decided == 1:  # the absence of a gap needs two releases
        return decided
    for k in range(first):
        rng = np.random.default_rng([seed, k, 29])
        (look,) = played(plant.rig, at_random, partial(plant.record, rng=rng), rng, limits_of(plant.rig), most=1)
        pose = np.degrees(look.release.start[:2]).round()
        print(f"  first release {pose} deg: decided {look.is_last}", file=sys.stderr, flush=True)
        if look.is_last and is_right(plant, [look]):
            return 1
    return decided


def _judged(right: bool, true: bool) -> str:
    return "right" if right else "too small" if true else "wrong"


def bars(results: dict[str, list[tuple[list[SequentialLook], bool, bool]]]) -> list[Bar]:
    """Return the number of releases until decided, and shares of correct and of true diagnoses."""
    counts = {name: [_count(looks) for looks, *_ in each] for name, each in results.items()}
    mean = {name: float(np.mean(each)) for name, each in counts.items()}
    made = []
    for name, each in results.items():
        right, true = np.mean(
            [judged for looks, *judged in each if looks[-1].is_last] or [[np.nan] * 2], axis=0
        ).tolist()
        stopped = sum(looks[-1].is_last for looks, *_ in each)
        made.append(Bar(f"{name}: releases until decided, mean (of {len(each)})", "-", mean[name], None))
        made.append(at_least(f"{name}: correct when stopped (of {stopped})", right, 0.97))
        made.append(at_least(f"{name}: correct, or too small to detect (of {stopped})", true, 0.97))
        made.append(
            Bar(f"{name}: minutes at the rig, mean", "-", float(np.mean([_minutes(looks) for looks, *_ in each])), None)
        )
        if name != "menu" and "menu" in mean:
            made.append(at_most(f"{name}: releases relative to the menu", mean[name] / mean["menu"], 0.6))
        made += _of_plans(name, [looks for looks, *_ in each])
    return made


def _count(looks: Sequence[SequentialLook]) -> int:
    """Return the number of releases until decided; one more than the maximum if undecided."""
    return len(looks) if looks[-1].is_last else SEQUENTIAL.most + 1


def _minutes(looks: Sequence[SequentialLook]) -> float:
    """Time at the rig, minutes; the mounting does not change."""
    return sum(minutes(look.release, look.release.mounted, PlanLimits()) for look in looks)


def _as_outcome(look: SequentialLook) -> dict[str, Any]:
    return {"forecast": look.forecast, "decided": look.decided, "bench_check": look.bench_check}


def _of_plans(name: str, played_looks: Sequence[Sequence[SequentialLook]]) -> list[Bar]:
    """Calibration of the forecasts and time of the plans of one strategy; empty without plans."""
    claims = [claim for looks in played_looks for claim in forecast_claims([_as_outcome(look) for look in looks])]
    seconds = [look.plan_seconds for looks in played_looks for look in looks if look.plan_seconds is not None]
    made = list[Bar]()
    if claims:
        made.append(at_most(f"{name}: calibration error of {len(claims)} forecasts", calibration_error(claims), 0.05))
        made.append(Bar(f"{name}: of an exact forecast", "-", error_if_exact(claims), None))
        mean = float(np.mean([claim.probability for claim in claims]))
        made.append(Bar(f"{name}: mean forecast", "-", mean, None))
        made.append(Bar(f"{name}: share that occurred", "-", float(np.mean([claim.true for claim in claims])), None))
    if seconds:
        made.append(at_most(f"{name}: CPU time of the slowest plan, s", max(seconds), 5.0))
    return made


def main() -> None:
    """Draw the plants, apply each strategy, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="seed of the first plant")
    parser.add_argument("--first", type=int, default=0, help="other first releases tried for the minimum of a plant")
    parser.add_argument("--strategies", nargs="+", default=list(STRATEGIES), choices=list(STRATEGIES))
    args = parser.parse_args()
    results: dict[str, list[tuple[list[SequentialLook], bool, bool]]] = {name: [] for name in args.strategies}
    minima, fewest = list[int](), list[int]()
    for seed in range(args.seed, args.seed + (1 if args.quick else args.plants)):
        plant = drawn(seed)
        print(f"plant {seed}: {plant.effect or 'nothing'} {plant.size:.3g}", file=sys.stderr)
        fewest.append(1 if plant.effect else STOPPING.fewest)
        for name in args.strategies:
            rng, strategy = np.random.default_rng([seed, *name.encode()]), STRATEGIES[name]
            limits = limits_of(plant.rig, times=strategy.times)
            looks = played(plant.rig, strategy.choose, partial(plant.record, rng=rng), rng, limits)
            results[name].append((looks, is_right(plant, looks), is_true(plant, looks)))
            named = [effect.name for effect in looks[-1].diagnosis.effects]
            forecasts = [f"{look.forecast[0]:.2f}" for look in looks if look.forecast]
            print(
                f"  {name}: {len(looks)} releases, {looks[-1].diagnosis.verdict} {named},"
                f" {_judged(*results[name][-1][1:])}, stopped {looks[-1].is_last}, forecasts {forecasts}",
                file=sys.stderr,
                flush=True,
            )
        if args.first:
            counts = {name: _count(each[-1][0]) for name, each in results.items()}
            minima.append(least(plant, counts, args.first, seed))
            print(f"  minimum: {minima[-1]}", file=sys.stderr, flush=True)
    shown = bars(results)
    if "menu" in results:
        of_menu = sum(_count(looks) for looks, *_ in results["menu"])
        shown.append(Bar("smallest possible number of releases relative to the menu", "-", sum(fewest) / of_menu, None))
    if minima:
        shown.append(
            Bar(f"minimum: releases until decided, mean (of {len(minima)})", "-", float(np.mean(minima)), None)
        )
    show("plans on plants of MuJoCo", shown, args.json)


if __name__ == "__main__":
    main()
