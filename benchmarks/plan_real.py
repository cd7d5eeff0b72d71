"""Which of the given recordings of a real rig to fit first: the plan's choice against all others.

    python benchmarks/plan_real.py --data FOLDER [--only pendule_pi]

Each recording is fitted alone. What the fit predicts of the others, running free, is compared with the median over all
choices. The recording k to fit first is chosen at the rig file's values, before any is fitted. It has the least
expected error of the prediction of the others if the rig has an effect that the fit lacks. With H the information, R
the unknowns that every fit estimates, and a an amplitude of the library, the fit of k is wrong by

    delta_k = (P + H_k)_RR^-1 (H_k)_Ra    per unit of a,
    E_k^2 = sum over j != k of (H_j)_aa - 2 delta_k^T (H_j)_Ra + delta_k^T (H_j)_RR delta_k,

and the criterion is the geometric mean of E_k over the amplitudes whose typical size is visible in the others.
Of the rest, such as a zero offset that every recording fits for itself, only round-off remains. Source: G. E. P. Box &
N. R. Draper (1959), A basis for the selection of a response surface design, Journal of the American Statistical
Association 54, 622-654: where the model may be wrong, the bias of its predictions decides, not their variance.
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
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.moving_arm.setup import setup_of
from dpr_lab.planning.acting import Acting
from dpr_lab.planning.knowledge import information_of_runs, known_before
from dpr_lab.planning.worth.criteria import WORTH
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
    return lambda folder: _titled(folder, f"design {design}, driven")


def _titled(folder: Path, part: str) -> tuple[Rig, list[Run]]:
    """Rig and recordings of the first rig of the page of real rigs whose title contains a part."""
    found = next(one for one in rigs(folder) if part in one.title)
    return found.rig, found.runs


SETS: dict[str, Callable[[Path], tuple[Rig, list[Run]]]] = {
    "multiarm": multiarm,
    "pendule_pi": pendule_pi,
    **{f"dfki_driven {design}": dfki_driven(design) for design in ("A.0", "C.0", "C.1")},
}
"""Name of a set of recordings -> function that reads it."""


def expected_errors(rig: Rig, runs: list[Run]) -> list[float]:
    """Expected error of the prediction of all other recordings from each one, up to a common factor."""
    acting = Acting(frozenset({rig.rods.mounting})).including([setup_of(run, rig) for run in runs])
    known = known_before(rig, acting)
    H = [information_of_runs(Recordings((record(run, rig),), rig), known.model) for run in runs]
    typical = np.array([column.size for column in known.model.columns])
    return geometric_means(
        np.array(H) * typical[:, None] * typical, known.prior * typical[:, None] * typical, known.fitted
    )


def geometric_means(H: NDArray[np.float64], prior: NDArray[np.float64], fitted: list[int]) -> list[float]:
    """Geometric mean of E_k over the visible amplitudes, per typical size, from (n, k, k) information and prior."""
    power = np.delete(np.diagonal(H, axis1=1, axis2=2), fitted, axis=1)
    others = power.sum(axis=0) - power
    squared = np.maximum(biases(H, prior, fitted), WORTH.seen * others)[:, others.min(axis=0) > 1.0]
    return np.exp(0.5 * np.log(squared).mean(axis=1)).tolist()


def biases(H: NDArray[np.float64], prior: NDArray[np.float64], fitted: list[int]) -> NDArray[np.float64]:
    """(n, amplitudes) E_k^2 of each recording, from (n, k, k) information and (k, k) prior."""
    others = [i for i in range(H.shape[1]) if i not in fitted]
    inner, cross = H[np.ix_(range(len(H)), fitted, fitted)], H[np.ix_(range(len(H)), fitted, others)]
    diagonal = np.diagonal(H, axis1=1, axis2=2)[:, others]
    delta = np.linalg.solve(prior[np.ix_(fitted, fitted)] + inner, cross)
    errors = np.array(
        [diagonal - 2 * np.sum(d * cross, axis=1) + np.sum(d * (inner @ d), axis=1) for d in delta]
    )  # (fitted recording, predicted recording, amplitude)
    return errors.sum(axis=1) - errors[np.arange(len(H)), np.arange(len(H))]


def held_out_errors(rig: Rig, runs: list[Run], chosen: int) -> dict[str, float]:
    """Error of the free run along each recording that was not fitted, rad; inf where nothing could be fitted."""
    others = [run for k, run in enumerate(runs) if k != chosen]
    try:
        found = diagnose([runs[chosen]], rig, held_out=others)
    except DprError as error:
        print(f"  {runs[chosen].name}: {error}", file=sys.stderr)
        return {run.name: np.inf for run in others}
    free = found.gap.free_run_rad
    return {run.name: free[run.name]["after"] for run in others if run.name in free}


def bars(name: str, rig: Rig, runs: list[Run]) -> list[Bar]:
    """The plan's choice over the median of all choices, by the median over the recordings that every fit predicts."""
    expected = expected_errors(rig, runs)
    predicted = list[dict[str, float]]()
    for k, run in enumerate(runs):
        predicted.append(held_out_errors(rig, runs, k))
        every = np.median(list(predicted[-1].values()))
        print(
            f"{run.name}: expected error {expected[k]:.3g}, held-out error {every:.4f} rad", file=sys.stderr, flush=True
        )
    names = [run.name for run in runs]
    common = [name for name in names if all(name in errors or name == names[k] for k, errors in enumerate(predicted))]
    errors = [np.median([each[name] for name in common if name in each]) for each in predicted]
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
