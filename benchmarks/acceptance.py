"""Acceptance test of simulated rigs: pass rates of effects just above their limits, and at half of their limits.

    python benchmarks/acceptance.py --plants 20 --seed 1
    python benchmarks/acceptance.py --plants 20 --seed 1 --level several

A rig is drawn near `paper` with one effect of the library, and three releases of 6 s are recorded and diagnosed. The
limits are chosen with knowledge of the true values. Each amplitude of the effect, and each ratio, lies 5 % above its
limit (it must not pass) or at half of its limit (it should pass). A limit below the minimum detectable size is counted
separately, because the recordings cannot decide it. The same applies to a tolerance of a ratio below five standard
deviations. The limit of a ratio is a tolerance about a nominal value. The friction torque of each joint is limited up
to a slow and a fast speed. With `--level several`, a rig has two or three effects near their minimum detectable sizes,
so that some are not named. They distort the ratios. Each ratio then lies above and below the nominal value, with two
tolerances. Amplitudes of absent effects have their typical size as limit.
"""

import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise, product

import numpy as np
from _bars import Bar, at_least, at_most, options, show
from _trial_cases import Case, hidden, opened

from dpr_lab.acceptance.judge import Answer, judge
from dpr_lab.acceptance.limits import Limits
from dpr_lab.dynamics.base import RATIO_UNITS, RATIOS, base_parameters, ratios
from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import DetectableSizes
from dpr_lab.rig import PARAMETERS, Rig
from sim_device.plant.config import PlantConfig
from sim_device.trials.draw import alike, visible_effects
from sim_device.trials.offline_recorder import record

SWING_S = 6.0
ABOVE, HALF = 1.05, 0.5
"""Size in units of its limit."""
TARGETS = ("above", "half", "ratio above", "ratio half", "friction above", "friction half")
FRICTION_UP_TO = (0.5, 6.0)
"""Speeds of a joint up to which its friction torque is limited, rad/s."""
TOLERANCE = 0.03
"""Tolerance of a ratio, relative to its nominal value."""
NEAR = (0.4, 1.6)
"""Range of the sizes of several effects, in units of their minimum detectable sizes on a clean rig."""


@cache
def detectable() -> DetectableSizes:
    """Minimum detectable sizes on a clean rig."""
    plant, rig = hidden(Case("clean", "clean", 0))
    return diagnose(record(plant, rig, SWING_S), rig).detectable


def several(seed: int) -> tuple[PlantConfig, Rig]:
    """Draw a rig with two or three effects near their minimum detectable sizes; common effects are more frequent."""
    plant, rig = hidden(Case("clean", "clean", seed))
    rng, sizes = np.random.default_rng([seed, 7]), detectable()
    names = [name for name in visible_effects() if any(sizes.get(name, {}).values())]
    weights = np.array([5.0 if EFFECTS[name].common else 1.0 for name in names])
    effects: dict[str, dict[str, float]] = {}
    for name in rng.choice(names, len(names), replace=False, p=weights / weights.sum()).tolist():
        if len(effects) < 2 + seed % 2 and not any(alike(name, other) for other in effects):
            size = float(np.exp(rng.uniform(*np.log(NEAR))))
            effects[name] = {p.name: p.default for p in EFFECTS[name].shapes}
            for p in EFFECTS[name].amplitudes:
                sign = 1.0 if p.sign == "positive" or p.one_way else float(rng.choice([-1.0, 1.0]))
                effects[name][p.name] = sign * size * (sizes[name].get(p.name) or 0.0)
    return plant.model_copy(update={"effects": effects}), rig


def limit_of(effect: str, parameter: str, size: float) -> Limits:
    """Create a limit on one amplitude of an effect."""
    (unit,) = (p.unit for p in EFFECTS[effect].amplitudes if p.name == parameter)
    return Limits.model_validate({"effects": {effect: {parameter: {"max": size, "unit": unit}}}})


def range_of(ratio: str, true: float, share: float, relative: float = TOLERANCE) -> Limits:
    """Create a tolerance of a ratio. The true deviation from the nominal value is `share` of the tolerance."""
    nominal = true / (1 + share * relative)
    bounds = {"nominal": nominal, "tolerance": relative * abs(nominal), "unit": RATIO_UNITS[ratio]}
    return Limits.model_validate({"ratios": {ratio: bounds}})


def friction_limit(joint: int, speed: float, size: float) -> Limits:
    """Create a limit on the friction torque of a joint up to a speed."""
    bounds = {"max": size, "speed_rad_s": speed, "unit": "N m"}
    return Limits.model_validate({"friction": {f"joint{joint}": bounds}})


def largest_friction(effects: Mapping[str, Mapping[str, float]], joint: int, viscous: float, speed: float) -> float:
    """Largest friction torque of a joint up to a speed; nan if the friction also depends on other quantities."""
    u = np.linspace(1e-9, speed, 4001)
    torque = viscous * u
    for name, sizes in effects.items():
        law, of_joint = name.removesuffix(f"_joint{joint}"), name.endswith(f"_joint{joint}")
        if of_joint and law in ("load_friction", "hysteresis", "friction_drift"):
            return float("nan")
        if of_joint and law in ("coulomb", "stribeck"):
            torque += sizes["torque_Nm"]
        if of_joint and law == "stribeck":
            torque += sizes["extra_at_rest_Nm"] * np.exp(-((u / sizes["speed_rad_per_s"]) ** 2))
        if of_joint and law == "friction_curve":
            torque += max(sizes.get("forward_Nm", 0.0), sizes.get("backward_Nm", 0.0))
            for k, ends in enumerate(pairwise((0.0, 0.3, 1.0, 3.0, 8.0)), 1):
                torque += sizes.get(f"rise{k}_Nm", 0.0) * np.interp(u, ends, (0.0, 1.0))
    return float(torque.max())


def answers(seed: int, level: str) -> Iterator[tuple[str, str, Answer, str]]:
    """Yield kind, quantity, result and reason for every limit of one plant."""
    plant, rig = several(seed) if level == "several" else hidden(Case("single", f"single:{level}", seed))
    truth = opened(plant, rig)
    diagnosis = diagnose(record(plant, rig, SWING_S), rig)

    def judged(kind: str, limits: Limits) -> tuple[str, str, Answer, str]:
        (limit,) = judge(diagnosis, limits).limits
        return kind, limit.quantity, limit.answer, f"{limit.reason} {limit.interval90}"

    print(f"plant {seed}: {truth.effects}, {_words(diagnosis)}", file=sys.stderr)
    for name, sizes in truth.effects.items():
        for parameter in (p.name for p in EFFECTS[name].amplitudes if sizes.get(p.name)):
            for kind, share in (("above", ABOVE), ("half", HALF)):
                limit = abs(sizes[parameter]) / share
                detectable = diagnosis.detectable.get(name, {}).get(parameter)
                hidden_from = kind == "half" and (detectable is None or limit < detectable)
                yield judged("hidden" if hidden_from else kind, limit_of(name, parameter, limit))
    true = ratios(base_parameters(plant.Z, rig.L1, rig.g))
    stds = np.sqrt(np.diag(diagnosis.ratio_covariance)).tolist()
    for name, value, std in zip(RATIOS, true.tolist(), stds, strict=True):
        signs, least = ((1, -1), SIGMAS * std / abs(value)) if level == "several" else ((1,), TOLERANCE)
        for (kind, share), sign, relative in product(
            (("ratio above", ABOVE), ("ratio half", HALF)), signs, {TOLERANCE, least}
        ):
            hidden_from = kind == "ratio half" and relative * abs(value) < 1.001 * SIGMAS * std
            yield judged("ratio hidden" if hidden_from else kind, range_of(name, value, sign * share, relative))
    for joint, speed in product((1, 2), FRICTION_UP_TO):
        size = largest_friction(truth.effects, joint, plant.Z[PARAMETERS.index(f"c{joint}")], speed)
        for kind, share in (("friction above", ABOVE), ("friction half", HALF)):
            if np.isfinite(size):
                yield judged(kind, friction_limit(joint, speed, size / share))
    for name, effect in OF_FREE_SWINGS.items():
        if name not in truth.effects and not effect.absorbed_by:
            for p in effect.amplitudes:
                yield judged("absent", limit_of(name, p.name, p.typical))


def _words(diagnosis: Diagnosis) -> str:
    return f"{diagnosis.verdict} {[(e.name, round(e.probability, 2)) for e in diagnosis.effects]}"


def main() -> None:
    """Draw, record and diagnose plants, test their limits, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="seed of the first plant")
    parser.add_argument("--level", default="subtle", help="visibility of the effect: clear, subtle, faint; or several")
    args = parser.parse_args()
    counts: dict[str, Counter[Answer]] = {}
    for seed in range(args.seed, args.seed + (1 if args.quick else args.plants)):
        for kind, quantity, answer, reason in answers(seed, args.level):
            counts.setdefault(kind, Counter())[answer] += 1
            wanted = (answer == "pass") == ("half" in kind) or kind not in TARGETS
            if not wanted:
                print(f"  {kind}: {quantity} {answer}: {reason}", file=sys.stderr, flush=True)
    bars = []
    for kind, each in sorted(counts.items()):
        share, name = each["pass"] / each.total(), f"{kind}: share that passes (of {each.total()})"
        if kind in TARGETS:
            bars.append(at_most(name, share, 0.05) if "above" in kind else at_least(name, share, 0.9))
        else:
            bars.append(Bar(name, "-", share, None))
    show("limits of simulated rigs", bars, args.json)


if __name__ == "__main__":
    main()
