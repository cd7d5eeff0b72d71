"""Diagnosis of simulated rigs (MuJoCo) with a free or driven arm and one fault: correctness of the first named effect.

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
from dpr_lab.trials.score import CLAIMED
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


def tried(seed: int, fault: str, mode: str, both: bool, seconds: float) -> tuple[bool, bool, float, str]:
    """Simulate and diagnose one case.

    Returns:
        Whether the first named effect is correct, whether an incorrect effect has a high probability, CPU time, s, and
        the printed line.
    """
    rng = np.random.default_rng(seed)
    largest = 0.25 if both else 0.12
    plant = drawn_plant(rng, both, fault, 1.0, largest)
    rig = rig_of(plant, mode)
    runs = recorded(plant, rig, mode, rng, seconds, largest)
    began = time.process_time()
    try:
        done = diagnose(runs, rig)
    except DprError as error:
        return False, False, time.process_time() - began, str(error)
    spent = time.process_time() - began
    right = done.verdict == "no_gap" if not fault else bool(done.effects) and fault in done.effects[0].members
    sure = any(effect.probability > CLAIMED and fault not in effect.members for effect in done.effects)
    names = ", ".join(f"{effect.name} {effect.probability:.2f}" for effect in done.effects)
    return right, sure, spent, f"{done.verdict} [{names}] chi2 {done.chi2_per_dof:.3g}"


def main() -> None:
    """Print each case and the totals."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=15)
    parser.add_argument("--clean", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--only", nargs="+", help="simulate only these faults")
    options = parser.parse_args()
    right = wrong = false = sure = 0
    for i in range(options.cases + options.clean):
        mode = "free" if i % 4 == 3 else "driven"
        each = options.only or (FREE if mode == "free" else DRIVEN)
        fault = "" if i >= options.cases else each[(i // (4 if mode == "free" else 1)) % len(each)]
        both = (i // 2) % 2 == 0
        good, claimed, spent, line = tried(options.seed + i, fault, mode, both, options.seconds)
        print(f"{i:3d} {'both' if both else 'one '} {mode:6s} {fault or 'clean':22s} {'ok ' if good else 'NO '}"
              f" {spent:5.1f} s  {line}", flush=True)  # fmt: skip
        right += good and bool(fault)
        wrong += not good and bool(fault)
        false += not good and not fault
        sure += claimed
    print(
        f"first cause correct in {right} of {right + wrong}; incorrect causes above 0.9 in {sure};"
        f" false alarms {false} of {options.clean}"
    )


if __name__ == "__main__":
    main()
