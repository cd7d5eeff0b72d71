"""Blind cases of rigs with a free or driven arm and one fault, simulated by MuJoCo: what the diagnosis names first.

python benchmarks/moving_arm_diagnosis.py --cases 15 --clean 5
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from dpr_lab.errors import DprError
from dpr_lab.gap.diagnose import diagnose
from tests.arm_engine import drawn_plant, recorded, rig_of

DRIVEN = (
    "coulomb_joint0", "spring_joint0", "torque_scale_joint0", "input_delay", "torque_offset_joint0", "dead_zone_joint0",
    "saturation_joint0", "detent_joint0", "torque_ripple_joint0", "hard_stop_joint0", "encoder_scale_joint0",
    "coulomb_joint1", "air_drag_joint0", "backlash_joint0", "backlash_joint1",
)  # fmt: skip
FREE = (
    "coulomb_joint0", "spring_joint0", "detent_joint0", "coulomb_joint1", "encoder_scale_joint0", "air_drag_joint0",
    "backlash_joint0", "backlash_joint1",
)  # fmt: skip


def tried(seed: int, fault: str, mode: str, both: bool, seconds: float) -> tuple[str, bool, float, str]:
    """What the diagnosis said of one case: first name, whether it is right, CPU seconds, and a line."""
    rng = np.random.default_rng(seed)
    largest = 0.25 if both else 0.12
    plant = drawn_plant(rng, both, fault, 1.0, largest)
    rig = rig_of(plant, mode)
    runs = recorded(plant, rig, mode, rng, seconds, largest)
    began = time.process_time()
    try:
        done = diagnose(runs, rig)
    except DprError as error:
        return "refused", False, time.process_time() - began, str(error)
    spent = time.process_time() - began
    names = [effect.name for effect in done.effects]
    first = names[0] if names else done.verdict
    right = done.verdict == "no_gap" if not fault else bool(done.effects) and fault in done.effects[0].members
    sure = done.effects[0].probability if done.effects else 1.0
    line = f"{done.verdict} {names} {sure:.2f} chi2 {done.chi2_per_dof:.3g}"
    return first, right, spent, line


def main() -> None:
    """Print each case and the sums."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=15)
    parser.add_argument("--clean", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--only", nargs="+", help="these faults instead of all")
    options = parser.parse_args()
    right = wrong = false = 0
    for i in range(options.cases + options.clean):
        mode = "free" if i % 4 == 3 else "driven"
        each = options.only or (FREE if mode == "free" else DRIVEN)
        fault = "" if i >= options.cases else each[(i // (4 if mode == "free" else 1)) % len(each)]
        both = (i // 2) % 2 == 0
        _, good, spent, line = tried(options.seed + i, fault, mode, both, options.seconds)
        print(f"{i:3d} {'both' if both else 'one '} {mode:6s} {fault or 'clean':22s} {'ok ' if good else 'NO '}"
              f" {spent:5.1f} s  {line}", flush=True)  # fmt: skip
        right += good and bool(fault)
        wrong += not good and bool(fault)
        false += not good and not fault
    print(f"first name right {right} of {right + wrong}; false alarms {false} of {options.clean}")


if __name__ == "__main__":
    main()
