"""Choice of the recordings of a real rig to fit first, compared with all other choices.

    python benchmarks/plan_real.py --data FOLDER [--only pendule_pi] [--fitted 2] [--fixed]

Each recording is fitted alone, or each pair with `--fitted 2`. Free runs of the fit predict the other recordings. The
error of the choice is compared with the median over all choices. The choice is made before any fit: its ranges of joint
angles and speeds contain the largest share of the states of the other recordings. A fit compensates for effects that
the model lacks. The compensation is valid only within the range of the fitted recordings, even if the parameters are
accurate. Information about parameters, or about amplitudes of a library, does not describe this limit
(docs/benchmarks/planning.md lists results for both). `dpr-lab plan`, which proposes new recordings, does not use this
criterion.

Source: J. Brynjarsdottir & A. O'Hagan (2014), Learning about physical parameters: the importance of model discrepancy,
Inverse Problems 30, 114007.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from _bars import Bar, at_most, options, show
from _real import PIECE_S, PIECES
from numpy.typing import NDArray
from real import rigs

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import DprError
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.record import Record, record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.gap.which.fitted_sets import FittedSets
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

FIXED = {
    "multiarm": ("friction_curve_joint2", "air_drag_outer", "coulomb_joint1"),
    "pendule_pi": ("encoder_scale_joint1",),
    "dfki_driven": ("coulomb_joint1", "coulomb_joint2", "rotor_inertia_joint2"),
}
"""Effects that are fitted with `--fixed`. Diagnoses of all recordings name them (docs/real-rigs.md)."""

SETS: dict[str, Callable[[Path], tuple[Rig, list[Run]]]] = {
    "multiarm": multiarm,
    "pendule_pi": pendule_pi,
    **{f"dfki_driven {design}": dfki_driven(design) for design in ("A.0", "C.0", "C.1")},
}
"""Function that reads each set of recordings, by name."""


def choices(runs: Sequence[Run], fitted: int) -> list[tuple[int, ...]]:
    """Return the indices of the fitted recordings of each choice."""
    return list(combinations(range(len(runs)), fitted))


def covered_shares(rig: Rig, runs: Sequence[Run], fitted: int = 1) -> list[float]:
    """For each choice, the share of the states of all other recordings within the range of a chosen one, 0 to 1."""
    sizes = [states(record(run, rig)) for run in runs]
    inside = [[(size <= limits.max(axis=0)).all(axis=1) for size in sizes] for limits in sizes]
    return [
        float(np.mean([np.any([inside[k][j] for k in chosen], axis=0).mean() for j in others_of(chosen, runs)]))
        for chosen in choices(runs, fitted)
    ]


def others_of(chosen: Sequence[int], runs: Sequence[Run]) -> list[int]:
    """Return the indices of the recordings that are not fitted."""
    return [k for k in range(len(runs)) if k not in chosen]


def states(recorded: Record) -> NDArray[np.float64]:
    """(n, 4) absolute values of the joint angles from hanging, rad, and of the joint speeds, rad/s."""
    stride = max(1, round(SPACING_S / float(np.median(np.diff(recorded.t)))))
    t, joints = recorded.t[::stride], recorded.joints[::stride]
    angles = (joints - [np.pi, 0.0] + np.pi) % (2 * np.pi) - np.pi
    return np.abs(np.hstack([angles, np.gradient(joints, t, axis=0)]))


def held_out_errors(rig: Rig, runs: Sequence[Run], chosen: Sequence[int], fixed: Sequence[str]) -> dict[str, float]:
    """Error of the free run along each recording that was not fitted, rad; inf if the fit failed.

    The fit is that of a diagnosis, or that of the effects `fixed`.
    """
    others = [runs[k] for k in others_of(chosen, runs)]
    try:
        if fixed:
            return fixed_errors(rig, [runs[k] for k in chosen], others, fixed)
        diagnosis = diagnose([runs[k] for k in chosen], rig, held_out=others)
    except DprError as error:
        print(f"  {error}", file=sys.stderr)
        return {run.name: np.inf for run in others}
    free = diagnosis.gap.free_run_rad
    return {run.name: free[run.name]["after"] for run in others if run.name in free}


def fixed_errors(rig: Rig, runs: Sequence[Run], others: Sequence[Run], effects: Sequence[str]) -> dict[str, float]:
    """Error of the free run along the other recordings, rad, after a fit of given effects."""
    prepared, unseen = ([record(run, rig) for run in group] for group in (runs, others))
    recordings, problem, model = fit_bare_model(Recordings(tuple(prepared), rig), nominal_ratios(rig))
    fitted_sets = FittedSets(recordings, problem, {effect: EFFECTS[effect] for effect in effects}, model)
    for effect in effects:
        score = fitted_sets.score(model, effect)
        model = fitted_sets.with_one(model, score) if score else model
    return free_runs(recordings.only(unseen), model.estimate).errors_rad


def bars(name: str, rig: Rig, runs: Sequence[Run], fitted: int, fixed: Sequence[str]) -> list[Bar]:
    """Error of the choice relative to the median over all choices.

    The error of a choice is its median over the recordings that are predicted by every fit without them.
    """
    every, shares = choices(runs, fitted), covered_shares(rig, runs, fitted)
    names, predicted = [run.name for run in runs], list[dict[str, float]]()
    for chosen, share in zip(every, shares, strict=True):
        predicted.append(held_out_errors(rig, runs, chosen, fixed))
        error, label = np.median(list(predicted[-1].values())), " and ".join(names[k] for k in chosen)
        print(f"{label}: covers {share:.3f}, held-out error {error:.4f} rad", file=sys.stderr, flush=True)
    common = [
        name
        for k, name in enumerate(names)
        if all(name in errors or k in chosen for chosen, errors in zip(every, predicted, strict=True))
    ]
    errors = np.array([np.median([each[name] for name in common if name in each]) for each in predicted])
    best = int(np.argmax(shares))
    label = f"{name}: {fitted} of {len(runs)} recordings, {len(every)} choices"
    return [
        at_most(f"{label}: held-out error of the choice over the median", errors[best] / np.median(errors), 1),
        Bar(f"{label}: held-out error of the choice, rad", "-", errors[best], None),
        Bar(f"{label}: rank of the choice", "-", 1 + int(np.sum(errors < errors[best])), None),
    ]


def main() -> None:
    """Import the recordings, choose and fit, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder of the real recordings")
    parser.add_argument("--fitted", type=int, default=1, help="number of recordings that are fitted together")
    parser.add_argument("--fixed", action="store_true", help="fit the effects of FIXED instead of a diagnosis")
    parser.add_argument("--only", default="", help="use only sets whose name begins with this text")
    args = parser.parse_args()
    each = [(name, *read(args.data)) for name, read in SETS.items() if name.startswith(args.only)]
    each = [(name, rig, runs[:3] if args.quick else runs) for name, rig, runs in each]
    for name, _, runs in each:
        if not 0 < args.fitted < len(runs):
            parser.error(f"--fitted must be from 1 to {len(runs) - 1}: {name} has {len(runs)} recordings, one held out")
    every = list[list[Bar]]()
    for name, rig, runs in each:
        every.append(bars(name, rig, runs, args.fitted, FIXED[name.split()[0]] if args.fixed else ()))
    show("plan on real recordings", [bar for some in every for bar in some], args.json)


if __name__ == "__main__":
    main()
