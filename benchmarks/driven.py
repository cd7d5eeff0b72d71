"""Prediction of the driven joints of a real rig, compared with the published model of its authors.

python benchmarks/driven.py FOLDER [DESIGN ...] [--torque commanded]

FOLDER contains dfki_driven. Two records of each design are fitted, with friction, rotor inertia, drive effects and the
zero offsets of the encoders in each record. The third record is predicted in windows of 2 s: by this fit, and by the
authors' equations with their published parameters, which this file implements separately. In each window, the initial
state of each prediction is fitted to the first 0.3 s, which the error excludes. The error also excludes the first
window of the third record, because it determines the zero offsets of the encoders.
"""

import argparse
import json
import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from _bars import Bar, at_most, show
from _real import rezeroed
from numpy.typing import NDArray
from scipy.optimize import least_squares

from dpr_lab.dynamics.prediction import PAD, predict
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import EFFECTS, effect_params, named_params
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.hypothesis.hypothesis import free_parameters
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import own_zeros
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure

Array = NDArray[np.float64]
Predictor = Callable[[Array, Array], Array]
"""Function from times (n,), s, and the state (4,) before the first of them to the angles of both rods (n, 2), rad."""

DESIGNS = ("A.0", "C.0", "C.1")
WINDOW_S, SETTLE_S, STEP_S = 2.0, 0.3, 1e-3
INITIAL_SHARE = 0.01
"""Initial value in the fit of an effect, relative to its typical size."""
DRIVE = (
    ["coulomb_joint1", "coulomb_joint2", "rotor_inertia_joint2"],
    ["torque_offset_joint1", "torque_offset_joint2"],
    ["torque_scale_joint2"],
    ["input_delay"],
)
"""Effects of geared drives without ripple, whose order is unknown."""


def records(folder: Path, design: str, torque: str) -> tuple[Rig, dict[str, float], list[Run]]:
    """Drafted rig, the authors' model, and three records of a design."""
    files = sorted(folder.glob(f"{design}_*.csv"))
    document = json.loads(files[0].with_suffix(".json").read_text(encoding="utf-8"))
    model, lengths = document["authors_model"], document["lengths"]
    inner, outer = Measure(model["m1"]), Measure(model["m2"])
    drafted = draft_rig(RigMeasures(f"dfki {design}", lengths["l1_m"], lengths["l2_m"], inner, outer))
    rig = rezeroed(parse_rig(drafted))
    options = ImportOptions(zero="hanging", angles="relative", torque=torque)  # type: ignore[arg-type]
    return rig, model, [import_csv(file, rig, options) for file in files]


def windows(run: Run) -> list[tuple[Array, Array]]:
    """Instants and angles of both rods in each window."""
    begins = np.arange(run.t[0] + PAD, run.t[-1] - WINDOW_S, WINDOW_S)
    inside = [(run.t >= begin) & (run.t < begin + WINDOW_S) for begin in begins]
    return [(run.t[some], run.theta[some, 1:]) for some in inside]


def initial_state(predicted_angles: Predictor, t: Array, theta: Array) -> Array:
    """Fit the state (4,) of a model at `PAD` before t[0] to the first readings."""
    head = t < t[0] + SETTLE_S
    line = np.polynomial.polynomial.polyfit(t[head] - t[0] + PAD, theta[head], 4)
    result = least_squares(
        lambda x: (predicted_angles(t[head], x) - theta[head]).ravel(),
        np.concatenate([line[0], line[1]]),
        diff_step=1e-5,
    )
    return result.x


def authors(model: dict[str, float], run: Run, t: Array, state: Array) -> Array:
    """Angles (n, 2) of both rods at `t`, simulated with the authors' equations.

    The equations use joint angles from the hanging position, and rotors with gears.
    """
    I1, I2, Ir, n, g = (model[name] for name in ("I1", "I2", "Ir", "gr", "g"))
    l1, m1, m2, r1, r2 = (model[name] for name in ("l1", "m1", "m2", "r1", "r2"))
    b1, b2, dry1, dry2 = (model[name] for name in ("b1", "b2", "cf1", "cf2"))
    assert run.torques is not None
    torques = run.torques

    def slope(x: list[float], tau1: float, tau2: float) -> tuple[float, ...]:
        q1, q2, v1, v2 = x
        k, s = m2 * l1 * r2 * math.cos(q2), m2 * l1 * r2 * math.sin(q2)
        M11, M12, M22 = I1 + I2 + m2 * l1**2 + 2 * k + n**2 * Ir + Ir, I2 + k - n * Ir, I2 + n**2 * Ir
        pull = -m2 * g * r2 * math.sin(q1 + q2)
        f1 = tau1 + 2 * s * v1 * v2 + s * v2**2 - (m1 * r1 + m2 * l1) * g * math.sin(q1) + pull
        f2 = tau2 - s * v1**2 + pull
        f1 -= b1 * v1 + dry1 * math.atan(100 * v1)
        f2 -= b2 * v2 + dry2 * math.atan(100 * v2)
        det = M11 * M22 - M12**2
        return v1, v2, (M22 * f1 - M12 * f2) / det, (M11 * f2 - M12 * f1) / det

    x = [state[0] - math.pi, state[1] - state[0], state[2], state[3] - state[2]]
    now, result = float(t[0]) - PAD, []
    held = np.maximum(np.searchsorted(run.t, t, side="right") - 2, 0)  # a reading ends the step of the torque before
    for end, i in zip(t.tolist(), held.tolist(), strict=True):
        count = max(1, math.ceil((end - now) / STEP_S))
        h, tau = (end - now) / count, torques[i].tolist()
        for _ in range(count):
            k1 = slope(x, *tau)
            k2 = slope([a + h / 2 * k for a, k in zip(x, k1, strict=True)], *tau)
            k3 = slope([a + h / 2 * k for a, k in zip(x, k2, strict=True)], *tau)
            k4 = slope([a + h * k for a, k in zip(x, k3, strict=True)], *tau)
            x = [a + h / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True)]
        now = end
        result.append((x[0] + math.pi, x[0] + x[1] + math.pi))
    return np.array(result)


def ours(at: tuple[Array, Array], rig: Rig, run: Run, t: Array, state: Array) -> Array:
    """Angles (n, 2) of both rods at `t`, simulated with base parameters and effects.

    The simulation starts `PAD` before the first reading.
    """
    laid_out = segments([t], setups=[run.setup])
    read = predict(*at, rig_constants(rig), laid_out, state[None])
    return np.column_stack([read[:, 0], read.sum(axis=1)])


def errors(run: Run, predicted_angles: Predictor) -> Array:
    """Rms errors (windows,) of both angles, without the first readings of each window, rad."""
    result = []
    for t, theta in windows(run)[1:]:
        later = t >= t[0] + SETTLE_S
        angles = predicted_angles(t, initial_state(predicted_angles, t, theta))
        result.append(np.sqrt(np.mean((angles - theta)[later] ** 2)))
    return np.array(result)


def zeros(run: Run, at: Estimate, rig: Rig) -> Array:
    """Zero offsets (2,) of the encoders of joints 1 and 2 in a record, estimated from its first window, rad."""
    first = record(run.between(run.t[0], run.t[0] + PAD + WINDOW_S), rig)
    return own_zeros(Recordings((first,), rig), at, 25)[0]


def fitted(runs: Sequence[Run], rig: Rig) -> Estimate:
    """Fit ratios, scale, friction, rotor inertia and drive effects to records."""
    recordings = Recordings(tuple(record(run, rig) for run in in_pieces(runs, ())[0]), rig, exact_torques=True)
    _, problem, bare = fit_bare_model(recordings, nominal_ratios(rig))
    at, names = bare.fit.estimate, list[str]()
    for some in DRIVE:  # one after another, each from a small value
        names += some
        small = effect_params(
            {name: {p.name: INITIAL_SHARE * p.typical for p in EFFECTS[name].amplitudes} for name in some}
        )
        at = at.changed(params=at.params + small - effect_params({}))
        at = fit(problem, at, free_parameters(at, names, problem), iterations=25).estimate
    return at


def compared(folder: Path, design: str, torque: str) -> list[Bar]:
    """Results for one design: two records are fitted, and the third is predicted."""
    rig, model, runs = records(folder, design, torque)
    at, unseen = fitted(runs[:2], rig), runs[2]
    print(f"{design}, {torque} torques: b {at.base[1]:.4g} kg m^2, the authors' {model['I2']:.4g}")
    print(f"  {named_params(at.params)}")
    read = zeros(unseen, at, rig)
    print(
        f"  zeros of joints 1 and 2, rad: fitted {np.round(at.zeros, 4).tolist()}, third {np.round(read, 4).tolist()}"
    )
    theirs, own = partial(authors, model, unseen), partial(ours, (at.whole, at.params), rig, unseen)
    rods = np.cumsum(read)
    lines = {
        "authors": errors(unseen, theirs),
        "authors with the zeros": errors(unseen, lambda t, state: theirs(t, state) + rods),
        "fitted": errors(unseen, lambda t, state: own(t, state) + rods),
    }
    for name, each in lines.items():
        print(f"  {name}: median {np.median(each):.4f} rad; windows {np.round(each, 3)}")
    ratio = float(np.median(lines["fitted"]) / np.median(lines["authors"]))
    return [at_most(f"{design}, {torque}: error over 2 s, in errors of the authors' printed model", ratio, 1.0)]


def main() -> None:
    """Print the comparison and its results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("designs", nargs="*", default=DESIGNS)
    parser.add_argument("--torque", choices=("measured", "commanded"), default="measured")
    args = parser.parse_args()
    bars = [bar for design in args.designs for bar in compared(args.folder / "dfki_driven", design, args.torque)]
    show("Driven joints", bars, False)


if __name__ == "__main__":
    main()
