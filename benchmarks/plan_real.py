"""Choice of the recording of a real rig to fit first, compared with all other choices.

    python benchmarks/plan_real.py --data FOLDER [--only pendule_pi]

Each recording is fitted alone, and free runs of the fit predict the other recordings. The error of the chosen recording
is compared with the median over all choices. The choice is made before any fit: it is the recording whose range of
joint angles and speeds contains the largest share of the states of the others. A fit compensates for effects that the
model lacks. The compensation is valid only within the range of the fitted recording, even if the parameters are
accurate. Information about parameters, or about amplitudes of a library, does not describe this limit
(docs/benchmarks.md lists results for both). `dpr-lab plan`, which proposes new recordings, does not use this criterion.

Source: J. Brynjarsdottir & A. O'Hagan (2014), Learning about physical parameters: the importance of model discrepancy,
Inverse Problems 30, 114007.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from _bars import Bar, at_most, options, show
from _real import PIECE_S, PIECES
from numpy.typing import NDArray
from real import rigs

from dpr_lab.errors import DprError
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.record import Record, record
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv


def multiarm(folder: Path) -> tuple[Rig, list[Run]]:
    """Rig and pieces of 10 s of the published free swing."""
    rig, file = load_rig("multiarm"), folder / "multiarm" / "dp_freeswing_1khz.csv"
    cuts = [ImportOptions(zero="hanging", start_s=PIECE_S * k, duration_s=PIECE_S) for k in range(PIECES)]
    return rig, [replace(import_csv(file, rig, cut), name=f"piece {k}") for k, cut in enumerate(cuts)]


def pendule_pi(folder: Path) -> tuple[Rig, list[Run]]:
    """Rig and packets of 5 s of one rod on a fixed cart, in counts of its encoder."""
    return _titled(folder, "Pendule-Pi")


def dfki_driven(design: str) -> Callable[[Path], tuple[Rig, list[Run]]]:
    """Return the function that reads the driven records of one design, with known joint torques."""
    return lambda folder: _titled(folder, f"design {design}, driven")


def _titled(folder: Path, part: str) -> tuple[Rig, list[Run]]:
    """Rig and recordings of the first real rig whose title contains a text."""
    result = next(one for one in rigs(folder) if part in one.title)
    return result.rig, result.runs


SPACING_S = 0.02
"""Interval over which speeds are computed as differences, s. Over shorter intervals, noise dominates."""

SETS: dict[str, Callable[[Path], tuple[Rig, list[Run]]]] = {
    "multiarm": multiarm,
    "pendule_pi": pendule_pi,
    **{f"dfki_driven {design}": dfki_driven(design) for design in ("A.0", "C.0", "C.1")},
}
"""Function that reads each set of recordings, by name."""


def covered_shares(rig: Rig, runs: list[Run]) -> list[float]:
    """For each recording, the share of the states of all others that lie within its range, 0 to 1."""
    sizes = [states(record(run, rig)) for run in runs]
    reached = [size.max(axis=0) for size in sizes]
    return [
        float(np.mean([(size <= most).all(axis=1).mean() for j, size in enumerate(sizes) if j != k]))
        for k, most in enumerate(reached)
    ]


def states(recorded: Record) -> NDArray[np.float64]:
    """(n, 4) absolute values of the joint angles from hanging, rad, and of the joint speeds, rad/s."""
    stride = max(1, round(SPACING_S / float(np.median(np.diff(recorded.t)))))
    t, joints = recorded.t[::stride], recorded.joints[::stride]
    angles = (joints - [np.pi, 0.0] + np.pi) % (2 * np.pi) - np.pi
    return np.abs(np.hstack([angles, np.gradient(joints, t, axis=0)]))


def held_out_errors(rig: Rig, runs: list[Run], chosen: int) -> dict[str, float]:
    """Error of the free run along each recording that was not fitted, rad; inf if the fit failed."""
    others = [run for k, run in enumerate(runs) if k != chosen]
    try:
        diagnosis = diagnose([runs[chosen]], rig, held_out=others)
    except DprError as error:
        print(f"  {runs[chosen].name}: {error}", file=sys.stderr)
        return {run.name: np.inf for run in others}
    free = diagnosis.gap.free_run_rad
    return {run.name: free[run.name]["after"] for run in others if run.name in free}


def bars(name: str, rig: Rig, runs: list[Run]) -> list[Bar]:
    """Error of the chosen recording relative to the median over all choices.

    The error of a choice is its median over the recordings that every fit predicts.
    """
    shares = covered_shares(rig, runs)
    predicted = list[dict[str, float]]()
    for k, run in enumerate(runs):
        predicted.append(held_out_errors(rig, runs, k))
        every = np.median(list(predicted[-1].values()))
        print(f"{run.name}: covers {shares[k]:.2f}, held-out error {every:.4f} rad", file=sys.stderr, flush=True)
    names = [run.name for run in runs]
    common = [name for name in names if all(name in errors or name == names[k] for k, errors in enumerate(predicted))]
    errors = [np.median([each[name] for name in common if name in each]) for each in predicted]
    best = int(np.argmax(shares))
    return [
        at_most(f"{name}: held-out error of the chosen recording over the median", errors[best] / np.median(errors), 1)
    ]


def main() -> None:
    """Import the recordings, choose and fit, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of the real recordings")
    parser.add_argument("--only", default="", help="use only sets whose name begins with this text")
    args = parser.parse_args()
    each = [(name, *read(args.data)) for name, read in SETS.items() if name.startswith(args.only)]
    every = [bars(name, rig, runs[:3] if args.quick else runs) for name, rig, runs in each]
    show("plan on real recordings", [bar for some in every for bar in some], args.json)


if __name__ == "__main__":
    main()
