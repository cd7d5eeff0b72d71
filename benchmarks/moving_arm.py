"""Identification of rigs with a free or driven arm: errors over Cramer-Rao bounds, and coverage of intervals.

    python benchmarks/moving_arm.py [--rigs 100] [--first 0] [--step 1] [--quick] [--json]

The rigs are random within 15 % of the rig `paper`, with arms of random inertia and friction. The arm is free or driven
by a known torque, with both rods or the inner rod alone, in turn. Every eighth rig is simulated by SciPy as point
masses, the others by MuJoCo. Neither shares code with dpr-lab. Each rig has two releases of 5 s at 200 Hz, with 14-bit
encoders and a noise of half a count. The Cramer-Rao bound is that of whole swings with unknown initial states. With
twice the torque, swings of both rods are so chaotic that no segment of 5 s can be integrated. The bound can then not be
reached.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from _bars import Bar, at_most, options, show
from numpy.typing import NDArray

from dpr_lab.dynamics.arm import ArmParameters, mounted
from dpr_lab.dynamics.moving_arm.followed import FOLLOW
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.linearise import linearise
from dpr_lab.identification.moving_arm.identify import identify_moving_arm
from dpr_lab.identification.moving_arm.problem import arm_problem, recordings_of
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.point_masses import point_masses
from tests.three_hinges import three_hinges

RATE_HZ, SWING_S, WITHIN, L0 = 200, 5.0, 0.15, 0.3
KINDS = (("free", "both"), ("driven", "both"), ("free", "inner"), ("driven", "inner"))
"""Mode of the arm, and mounted rods."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of the identification of one rig."""

    kind: tuple[str, str]
    engine: str
    over_bound: Mapping[str, float]
    """Error of each ratio over its Cramer-Rao bound."""
    over_std: Mapping[str, float]
    """Error of each ratio over its stated standard deviation."""
    segment_s: float
    misfit: float
    """Reduced chi-square of the fit."""


def rig_of(mode: str, rods: str) -> Rig:
    """Return the rig `paper` with a free or driven arm."""
    table = load_rig("paper").model_dump(exclude_none=True)
    table["rig"]["L0"] = L0
    table["rods"]["mounted"] = rods
    table["arm"] = {"mode": mode, "A": {"nominal": 0.08, "lower": 0.01, "upper": 1.0}}
    if mode == "driven":
        table["motor"] = {"input": "torque"}
    return Rig.model_validate(table)


def recorded(rig: Rig, swing: Array, torque: Array | None, t: Array, rng: np.random.Generator, name: str) -> Run:
    """Convert a simulated swing (n, 3) to a recording in counts."""
    counts = np.rint(rig.positions(swing) + rng.normal(0, rig.encoders.noise_counts, swing.shape)).astype(np.int64)
    theta = rig.theta(counts)
    if rig.rods.mounted == "inner":
        theta[:, 2] = theta[:, 1]
    return Run(
        name, t, theta, counts, None, rig.name, "", RATE_HZ,
        mounting=rig.rods.mounting, arm_mode=rig.arm.mode, arm_input=torque,
    )  # fmt: skip


def answer(seed: int) -> Answer:
    """Draw, record and identify one rig, and return its errors."""
    rng, kind = np.random.default_rng(seed), KINDS[seed % len(KINDS)]
    rig, engine = rig_of(*kind), "scipy" if seed // len(KINDS) % 8 == 0 else "MuJoCo"
    t = np.arange(round(SWING_S * RATE_HZ)) / RATE_HZ
    Z = rig.nominal * rng.uniform(1 - WITHIN, 1 + WITHIN, 9)
    if kind[1] == "inner":
        Z[[3, 4, 6, 8]] = (1e-9, 1e-9, 0.0, 1e-12) if engine == "MuJoCo" else 0.0
    arm = ArmParameters(J0=rng.uniform(0.01, 0.03), c0=rng.uniform(0.01, 0.05), mode="free")
    starts, runs = [], []
    for k in range(2):
        start = np.zeros(6)
        start[1:3] = np.pi + rng.choice([-1, 1]) * rng.uniform(0.4, 1.0), np.pi + rng.uniform(-1.0, 1.0)
        start[2] = start[1] if kind[1] == "inner" else start[2]
        rates = rng.uniform([3.0, 6.0], [5.0, 9.0])
        torque = 0.25 * np.sin(rates[0] * t) + 0.2 * np.sin(rates[1] * t + 1) if kind[0] == "driven" else 0.0 * t
        frame = (rig.L0, rig.L1, rig.g)
        if engine == "scipy":
            swing = point_masses(Z, arm, start, t, torque, frame)
        else:
            swing = three_hinges(mujoco, Z, arm, start, t, torque, frame)
        runs.append(recorded(rig, swing, torque if kind[0] == "driven" else None, t, rng, f"rig {seed}, release {k}"))
        starts.append(start)
    model = identify_moving_arm(runs, rig)
    truth, bound = true_ratios(rig, Z, arm, runs, np.array(starts))
    missing = [name for name in truth if name not in model.ratios]
    error = {name: one.value - truth[name] for name, one in model.ratios.items()}
    if missing:
        print(f"rig {seed}: not determined: {', '.join(missing)}")
    return Answer(
        kind,
        engine,
        {name: value / bound[name] for name, value in error.items()},
        {name: value / model.ratios[name].std for name, value in error.items()},
        model.fit.segment_s,
        model.fit.chi2_per_dof,
    )


def true_ratios(
    rig: Rig, Z: Array, arm: ArmParameters, runs: list[Run], starts: Array
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the true value and Cramer-Rao bound of each ratio.

    The bound is the smallest possible standard deviation from whole swings with unknown initial states.
    """
    base, held = mounted(np.maximum(Z, 1e-300), (rig.L0, rig.L1, rig.g), arm)
    scale = base.b if rig.rods.mounted == "both" else Z[7] + Z[2] * Z[0] ** 2
    if rig.rods.mounted == "inner":
        base = base._replace(a=scale, b=scale, d=0.0, e1=Z[2] * Z[0] * rig.g, c2=0.0)
    values = base._asdict() | {"A": held.inertia, "c0": held.friction, "k0": 0.0, "f0": 0.0, "gain": 1.0}
    p = np.array([values.get(name, 0.0) for name in SWING_PARAMETERS]) / scale
    p[SWING_PARAMETERS.index("L0")] = rig.L0
    recordings = recordings_of(runs, rig)
    problem, _ = arm_problem(recordings, rig, np.inf)
    # the angle of a missing rod stays zero, where it adds no inertia to the arm
    initial = np.where(problem.model.free, starts[:, np.argsort(FOLLOW.order)], 0.0)
    A, _ = linearise(problem, Estimate(p, initial), problem.unknowns.parameters).flat
    information = A.T @ A
    bounds = np.sqrt(np.diag(np.linalg.inv(information)))
    names = [problem.unknowns.name(parameter) for parameter in problem.unknowns.free]
    return dict(zip(names, p[problem.unknowns.places], strict=True)), dict(zip(names, bounds, strict=True))


def rms(values: list[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def bars(answers: list[Answer]) -> list[Bar]:
    """Errors and coverage of each kind of rig, and of all."""
    lines = []
    for kind in KINDS:
        some = [one for one in answers if one.kind == kind]
        if not some:
            continue
        title = f"{kind[0]} arm, {'both rods' if kind[1] == 'both' else 'one rod'} ({len(some)})"
        for name in some[0].over_bound:
            errors = [one.over_bound[name] for one in some if name in one.over_bound]
            lines.append(at_most(f"{title}: error of {name} over its bound, rms", rms(errors), 1.2))
    over = [value for one in answers for value in one.over_std.values()]
    coverage = 100 * float(np.mean(np.abs(over) < 1.645))
    lines.append(
        at_most("all: error over its bound, rms", rms([v for one in answers for v in one.over_bound.values()]), 1.2)
    )
    lines.append(Bar("all: 90 % intervals cover, %", "86 .. 94", coverage, 86 <= coverage <= 94))
    lines.append(Bar("all: error over stated std, rms", "1", rms(over), None))
    lines.append(Bar("all: segments, median, s", "-", float(np.median([one.segment_s for one in answers])), None))
    lines.append(at_most("all: reduced chi-square, worst", max(one.misfit for one in answers), 1.3))
    return lines


def main() -> None:
    """Draw and identify the rigs, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--rigs", type=int, default=100, help="number of rigs (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first rig")
    parser.add_argument("--step", type=int, default=1, help="between seeds; 4: one kind of rig (default: %(default)s)")
    args = parser.parse_args()
    answers = []
    for seed in range(args.first, args.first + args.step * (4 if args.quick else args.rigs), args.step):
        answers.append(one := answer(seed))
        worst = max(one.over_bound, key=lambda name: abs(one.over_bound[name]))
        print(
            f"{seed:5} {one.kind[0]:6} {one.kind[1]:5} {one.engine:6} segments of {one.segment_s:g} s, reduced"
            f" chi-square {one.misfit:.3f}, error over bound {rms([*one.over_bound.values()]):.2f} rms, worst {worst}"
            f" {one.over_bound[worst]:+.2f}",
            flush=True,
        )
    show("rigs with a free or driven arm", bars(answers), args.json)


if __name__ == "__main__":
    main()
