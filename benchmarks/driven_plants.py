"""Driven rigs: how often b of sealed plants with replayed torques lies within 3 std, and what of drives is named.

    python benchmarks/driven_plants.py [--plants 16] [--trials 20] [--quick] [--json]

Every plant is drawn around the paper's, its joints driven from the release on by torques that nobody chose, measured
with noise; two releases are identified. The rig file knows nothing of the plant but lengths and bounds. In a blind
trial the drives of the plant have a fault that chance chose, or none, and all its releases are diagnosed.
"""

import numpy as np
from _bars import Bar, at_least, at_most, options, show

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.identification.identify import identify
from dpr_lab.rig import Rig, load_rig
from dpr_lab.shown import percent
from sim_device.trials.driven import drawn_fault, driven_runs

FIRST_TRIAL = 100
"""Seed of the first blind trial, beyond those of the plants that are identified."""


def blind(rig: Rig, trials: int) -> list[Bar]:
    """Faults of drives, drawn and diagnosed: the first name right, and a gap where there was nothing."""
    right, alarms = list[bool](), list[bool]()
    for seed in range(FIRST_TRIAL, FIRST_TRIAL + trials):
        fault = drawn_fault(seed)
        found = diagnose(driven_runs(rig, seed, fault=fault)[1], rig)
        names = [(effect.name, *effect.members) for effect in found.effects]
        if fault:
            right.append(bool(names) and fault.name in names[0])
        else:
            alarms.append(found.verdict != "no_gap")
        print(f"trial {seed}: {fault or 'nothing'}; said {found.verdict}: {[effect.name for effect in found.effects]}")
    share = [at_least("blind faults of drives: first name right, share", float(np.mean(right)), 0.95)] if right else []
    return [*share, *([at_most("drives without a fault: a gap, share", float(np.mean(alarms)), 0.0)] if alarms else [])]


def main() -> None:
    """Print how many lie within, how wide the intervals are, and what was named."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=16)
    parser.add_argument("--trials", type=int, default=20)
    args = parser.parse_args()
    rig, within, std, off = load_rig("paper"), [], [], []
    for seed in range(2 if args.quick else args.plants):
        plant, runs = driven_runs(rig, seed)
        b = identify(runs[:2], rig).base["b"]
        assert b.std is not None
        true = float(base_parameters(plant.Z, rig.L1, rig.g)[1])
        std.append(b.std / b.value)
        off.append((b.value - true) / b.std)
        within.append(abs(off[-1]) <= 3)
        print(
            f"plant {seed}: b {b.value:.6g} kg m^2, true {true:.6g}, off by {off[-1]:+.2f} std of {percent(std[-1], 2)}"
        )
    scale = [at_least("scale of driven plants within 3 std, share", float(np.mean(within)), 0.95)] if within else []
    bars = [*scale, *blind(rig, 2 if args.quick else args.trials)]
    if not within:
        show("Driven plants", bars, args.json)
        return
    show("Driven plants", bars, args.json, std=float(np.median(std)), rms=float(np.sqrt(np.mean(np.square(off)))))


if __name__ == "__main__":
    main()
