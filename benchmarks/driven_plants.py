"""The common scale of driven rigs: how often b of sealed plants with replayed torques lies within 3 std.

    python benchmarks/driven_plants.py [--plants 16] [--quick] [--json]

Every plant is drawn around the paper's, its joints driven from the release on by torques that nobody chose, measured
with noise; two releases are identified. The rig file knows nothing of the plant but lengths and bounds.
"""

import numpy as np
from _bars import at_least, options, show

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.identification.identify import identify
from dpr_lab.rig import load_rig
from sim_device.trials.driven import driven_runs


def main() -> None:
    """Print how many lie within, and how wide the intervals are."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=16)
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
        print(f"plant {seed}: b {b.value:.6g} kg m^2, true {true:.6g}, off by {off[-1]:+.2f} std of {std[-1]:.2%}")
    bars = [at_least("scale of driven plants within 3 std, share", float(np.mean(within)), 0.95)]
    show("Driven plants", bars, args.json, std=float(np.median(std)), rms=float(np.sqrt(np.mean(np.square(off)))))


if __name__ == "__main__":
    main()
