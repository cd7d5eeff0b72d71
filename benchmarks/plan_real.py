"""Which of the given recordings of a real rig to fit first: the plan's choice against all others.

    python benchmarks/plan_real.py --data FOLDER [--only pendule_pi]

The information H of each recording is computed at the rig file's values, before any is fitted. The recording k to fit
first has the least expected error of the prediction of the others,

    sum over j != k of trace(H_j (P^-1 + H_k)^-1),

with every effect of the library unknown (Bayesian V-optimality: K. Chaloner & I. Verdinelli (1995), Bayesian
experimental design: a review, Statistical Science 10, 273-304). Each recording is then fitted alone. What the fit
predicts of the others, running free, is compared with the median over all choices.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from _bars import Bar, at_most, options, show
from _real import PIECE_S, PIECES
from real import rigs

from dpr_lab.errors import DprError
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.moving_arm.setup import setup_of
from dpr_lab.planning.acting import Acting
from dpr_lab.planning.knowledge import information_of_runs, known_before
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv


def multiarm(folder: Path) -> tuple[Rig, list[Run]]:
    """Pieces of 10 s of the published free swing."""
    rig, file = load_rig("multiarm"), folder / "multiarm" / "dp_freeswing_1khz.csv"
    cuts = [ImportOptions(zero="hanging", start_s=PIECE_S * k, duration_s=PIECE_S) for k in range(PIECES)]
    return rig, [replace(import_csv(file, rig, cut), name=f"piece {k}") for k, cut in enumerate(cuts)]


def pendule_pi(folder: Path) -> tuple[Rig, list[Run]]:
    """Packets of 5 s of one rod on a fixed cart, counts of its encoder."""
    return _titled(folder, "Pendule-Pi")


def dfki_driven(design: str) -> Callable[[Path], tuple[Rig, list[Run]]]:
    """Driven records of one design, joint torques known."""
    return lambda folder: _titled(folder, f"design {design}")


def _titled(folder: Path, part: str) -> tuple[Rig, list[Run]]:
    """Rig and recordings of the page of real rigs whose title contains a part."""
    (found,) = [one for one in rigs(folder) if part in one.title]
    return found.rig, found.runs


SETS: dict[str, Callable[[Path], tuple[Rig, list[Run]]]] = {
    "multiarm": multiarm,
    "pendule_pi": pendule_pi,
    **{f"dfki_driven {design}": dfki_driven(design) for design in ("A.0", "C.0", "C.1")},
}
"""Name of a set of recordings -> function that reads it."""


def expected_errors(rig: Rig, runs: list[Run]) -> list[float]:
    """Expected error of the prediction of all other recordings from each one, from the rig file alone.

    Returns:
        root of the mean square over the others, in standard deviations of the noise
    """
    acting = Acting(frozenset({rig.rods.mounting})).besides([setup_of(run, rig) for run in runs])
    known = known_before(rig, acting)
    H = [information_of_runs(Recordings((record(run, rig),), rig), known.model) for run in runs]
    covariances = [np.linalg.inv(known.information + of_run) for of_run in H]
    squared = [
        sum(float(np.sum(other * covariance)) for j, other in enumerate(H) if j != k)
        for k, covariance in enumerate(covariances)
    ]
    return np.sqrt(np.array(squared) / (len(runs) - 1)).tolist()


def held_out_error(rig: Rig, runs: list[Run], chosen: int) -> float:
    """Median error of free runs along the recordings that were not fitted, rad; inf where nothing could be fitted."""
    others = [run for k, run in enumerate(runs) if k != chosen]
    try:
        found = diagnose([runs[chosen]], rig, held_out=others)
    except DprError as error:
        print(f"  {runs[chosen].name}: {error}", file=sys.stderr)
        return np.inf
    return float(np.median([found.gap.free_run_rad[run.name]["after"] for run in others]))


def bars(name: str, rig: Rig, runs: list[Run]) -> list[Bar]:
    """The plan's choice over the median of all choices."""
    expected = expected_errors(rig, runs)
    errors = []
    for k, run in enumerate(runs):
        errors.append(held_out_error(rig, runs, k))
        print(
            f"{run.name}: expected error {expected[k]:.3g}, held-out error {errors[-1]:.4f} rad",
            file=sys.stderr,
            flush=True,
        )
    best = int(np.argmin(expected))
    return [
        at_most(f"{name}: held-out error of the plan's choice over the median", errors[best] / np.median(errors), 1)
    ]


def main() -> None:
    """Import, rate, fit, print."""
    parser = options(__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of the real recordings")
    parser.add_argument("--only", default="", help="sets whose name begins so")
    args = parser.parse_args()
    each = [(name, *read(args.data)) for name, read in SETS.items() if name.startswith(args.only)]
    every = [bars(name, rig, runs[:3] if args.quick else runs) for name, rig, runs in each]
    show("plan on real recordings", [bar for some in every for bar in some], args.json)


if __name__ == "__main__":
    main()
