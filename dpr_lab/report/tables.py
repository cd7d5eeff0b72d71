"""An identification as rows of text: each number with its uncertainty and what fixed it, runs by pose and time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import NONE, interval, pair, plus_minus, three
from dpr_lab.report.words import scaled_unit
from dpr_lab.shown import FIXED_BY

if TYPE_CHECKING:
    from dpr_lab.identification.compare import Comparison
    from dpr_lab.identification.model import Model

RATIO_COLUMNS = ("ratio", "value ± std", "90 % interval", "unit")
RATIO_NOTE = (
    "a: inertia about joint 1; d: coupling of the rods; e1: gravity on joint 1; c1, c2: viscous friction of the joints;"
    " all over b, the inertia of the outer rod about joint 2."
)
PARAMETER_COLUMNS = ("parameter", "value ± std", "90 % interval", "unit", "fixed by", "what it is")
PARAMETER_NOTE = (
    "A measured value is one of the rig file (a scale, a calliper). Only its bounds: nothing here shows it, and other"
    " values between the bounds of the rig file fit as well; measuring it is what helps. Its 90 % interval takes those"
    " bounds as a prior."
)
BASE_COLUMNS = ("base parameter", "value ± std", "unit", "what it is")
COMPARISON_COLUMNS = (
    "run",
    "role",
    "segments",
    "rms (mrad)",
    "noise (mrad)",
    "times noise",
    "free run (mrad)",
    "horizon (s)",
)
COMPARISON_NOTE = (
    "Numbers in pairs are θ1, θ2 (inner, outer rod). rms: residual of segments with free start states. "
    "Free run: residual of one simulation from the release to the horizon. "
    "Held out: the run took no part in the fit. ≥: predictable to the end of the record."
)
RUN_COLUMNS = ("file", "pose", "samples", "duration (s)", "segments", "χ² per dof", "SHA-256")
SEARCH_COLUMNS = ("what", "value")

BASE_UNITS = {
    "a": ("kg m²", "inertia about joint 1, the outer mass at joint 2"),
    "b": ("kg m²", "inertia of the outer rod about joint 2"),
    "d": ("kg m²", "coupling of the rods"),
    "e1": ("N m", "gravity on joint 1"),
    "c1": ("N m s/rad", "viscous friction of joint 1"),
    "c2": ("N m s/rad", "viscous friction of joint 2"),
}
RATIO_UNITS = {"a/b": "1", "d/b": "1", "e1/b": "1/s²", "c1/b": "1/s", "c2/b": "1/s"}
PARAMETER_UNITS = {
    "l1": ("m", "inner rod, pivot to centroid"),
    "l2": ("m", "outer rod, pivot to centroid"),
    "m1": ("kg", "mass of the inner rod"),
    "m2": ("kg", "mass of the outer rod"),
    "mb": ("kg", "mass of the encoder at joint 2"),
    "c1": ("N m s/rad", "viscous friction of joint 1"),
    "c2": ("N m s/rad", "viscous friction of joint 2"),
    "J1": ("kg m²", "inner rod, inertia at centroid"),
    "J2": ("kg m²", "outer rod, inertia at centroid"),
}


@dataclass(frozen=True, slots=True)
class NoiseLike:
    """Residual over noise floor within which the two are called equal.

    A noise floor is itself an estimate, from little data when there was no rest.
    """

    least: float = 0.8
    """Leaves a squared residual of 0.64; below it the floor is overstated."""
    most: float = 1.2
    """Leaves a squared residual of 1.44; above it the model misses something."""
    inflated: float = 1.5
    """Times the Cramér-Rao standard deviation from which the difference is explained."""


NOISE_LIKE = NoiseLike()


def summary(model: "Model", comparisons: "Sequence[Comparison]" = (), angles: AngleUnit = RADIANS) -> str:
    """One sentence: whether anything but noise is left, on the runs of the fit and on those held out."""
    if model.failures:
        return f"Not to be trusted: {'; '.join(model.failures)}."
    used = _worst(list(model.fit.rms_rad.values()), list(model.fit.noise_rad.values()))
    held_out = [_worst(c.segment_rms_rad, c.noise_rad) for c in comparisons if c.held_out]
    left, floor = (_both(by_axis, angles) for by_axis in (model.fit.rms_rad, model.fit.noise_rad))
    sizes = f"residual θ1, θ2: {left} against a noise floor of {floor}"
    return f"{_verdict(used, held_out)} ({sizes}; {_held_out(held_out)})."


def ratio_rows(model: "Model") -> list[list[str]]:
    """The five ratios, one row each, in the columns `RATIO_COLUMNS`."""
    return [
        [
            name,
            plus_minus(ratio.value, ratio.std),
            interval(*ratio.interval90, ratio.value, ratio.std),
            RATIO_UNITS.get(name, ""),
        ]
        for name, ratio in model.ratios.items()
    ]


def ratio_note(model: "Model") -> str:
    """What the ratios are, and why their standard deviations exceed those that `identifiability` prints."""
    noise_and_misfit = math.sqrt(max(1.0, model.fit.chi2_per_dof))
    times = [
        ratio.std / (noise_and_misfit * least)
        for name, ratio in model.ratios.items()
        if ratio.fixed_by == "data" and (least := model.cramer_rao_std[name]) > 0
    ]
    if not times or max(times) < NOISE_LIKE.inflated:
        return RATIO_NOTE
    return (
        f"{RATIO_NOTE} The standard deviations include misfit inflation: residuals that the model leaves are correlated"
        f" in time, so they are up to {three(max(times))} times the Cramér-Rao values, which `identifiability` prints"
        " for independent residuals."
    )


def base_rows(model: "Model") -> list[list[str]]:
    """The six base parameters in the columns `BASE_COLUMNS`; none where nothing in the runs showed their scale."""
    if model.base["b"].fixed_by != "data":
        return []
    return [
        [name, plus_minus(model.base[name].value, model.base[name].std), unit, meaning]
        for name, (unit, meaning) in BASE_UNITS.items()
    ]


def parameter_rows(model: "Model") -> list[list[str]]:
    """The nine kinetic parameters and what fixed each, in the columns `PARAMETER_COLUMNS`."""
    rows: list[list[str]] = []
    for name, parameter in model.parameters.items():
        unit, meaning = PARAMETER_UNITS.get(name, ("", ""))
        value, low_high = plus_minus(parameter.value, parameter.std), NONE
        if parameter.interval90 is not None:
            std = parameter.std or (parameter.interval90[1] - parameter.interval90[0]) / 2
            low_high = interval(*parameter.interval90, parameter.value, std)
        rows.append([name, value, low_high, unit, FIXED_BY[parameter.fixed_by], meaning])
    return rows


def parameter_note(model: "Model") -> str:
    """What the nine values rest on, and what b they assume where only ratios are identified."""
    return f"{PARAMETER_NOTE} {scaled_unit(model.scale.sentence)}" if model.scale else PARAMETER_NOTE


def comparison_rows(comparisons: "Sequence[Comparison]", angles: AngleUnit = RADIANS) -> list[list[str]]:
    """One row for each compared run, in the columns `COMPARISON_COLUMNS`."""
    return [
        [
            compared_name(comparison),
            ("held out" if comparison.held_out else "used")
            + (f", {comparison.torque_kind} torques" if comparison.torque_kind else ""),
            str(comparison.segments),
            pair(angles.small_per_rad * comparison.segment_rms_rad),
            pair(angles.small_per_rad * comparison.noise_rad),
            pair(_times(comparison.segment_rms_rad, comparison.noise_rad)),
            pair(angles.small_per_rad * comparison.free_run_rms_rad),
            ("≥ " if to_the_end(comparison) else "") + three(comparison.horizon_s),
        ]
        for comparison in comparisons
    ]


def run_rows(model: "Model") -> list[list[str]]:
    """The runs that the model was identified from, in the columns `RUN_COLUMNS`."""
    return [
        [
            run.file,
            (run.pose or NONE) + (f", {run.torque_kind} torques" if run.torque_kind else "") + _zeros(run.zeros_rad),
            str(run.samples),
            f"{run.duration_s:.4g}",
            str(run.segments),
            NONE if run.chi2_per_dof is None else three(run.chi2_per_dof),
            run.sha256 or NONE,
        ]
        for run in model.runs
    ]


def _zeros(fitted: Sequence[float]) -> str:
    """What encoders that are put to zero before each run read too much in it."""
    return f", zeros off by {' and '.join(f'{1e3 * zero:.3g}' for zero in fitted)} mrad" if fitted else ""


def search_rows(model: "Model") -> list[list[str]]:
    """How the model was found: enough to repeat the search, in the columns `SEARCH_COLUMNS`."""
    from dpr_lab.identification.objectives import objective_words
    from dpr_lab.search import search_words

    search, fit = model.search, model.fit
    chosen = f"{search_words(search.algorithm)}, objective {objective_words(search.objective)}, seed {search.seed}"
    best = ", ".join(f"{name} = {value:.4g}" for name, value in search.best.items())
    return [
        ["search", chosen],
        ["generations", str(search.generations)],
        ["evaluations", str(search.evaluations)],
        ["time", f"{three(search.seconds)} s"],
        ["cost of the best individual", f"{search.best_cost:.4g}"],
        ["best individual, before the local solver", best or NONE],
        ["local solver", f"{fit.iterations} iterations, {fit.segments} segments up to {fit.longest_segment_s:.3g} s"],
        ["χ² per degree of freedom", f"{three(fit.chi2_per_dof)} (1 = nothing left but noise)"],
    ]


def local_time(utc: str) -> str:
    """`2026-11-21 11:15 CET` of a time in UTC (ISO 8601, or as in the name of a run file); else as it is."""
    if len(utc) <= len("2026-11-21"):
        return utc
    try:
        at = datetime.fromisoformat(utc.replace("Z", "+00:00"))
        at = at if at.tzinfo is not None else at.replace(tzinfo=UTC)
        return f"{at.astimezone():%Y-%m-%d %H:%M %Z}"
    except (ValueError, OverflowError, OSError):  # no time, or none that this computer's clock knows
        return utc


def recorded(run: Path) -> str:
    """When a run was recorded, from a file name `<utc>_<pose>_<uid8>`; empty for others."""
    parts = run.stem.split("_")
    when = local_time(parts[0])
    return when if len(parts) > 2 and when != parts[0] else ""


def run_pose(run: Path) -> str:
    """The pose of a run, from a file name `<utc>_<pose>_<uid8>`; others by their name."""
    return "_".join(run.stem.split("_")[1:-1]) if recorded(run) else run.stem


def run_name(run: Path) -> str:
    """A run by its pose and when it was recorded, from a file name `<utc>_<pose>_<uid8>`; others by their name."""
    when = recorded(run)
    return f"{run_pose(run)} ({when})" if when else run.stem


def compared_name(comparison: "Comparison") -> str:
    """The run of a comparison; one that is not named by its pose has it in front."""
    name = run_name(Path(f"{comparison.run}.mcap"))
    return f"{comparison.pose} {name}" if comparison.pose and name == comparison.run else name


def to_the_end(comparison: "Comparison") -> bool:
    """Whether the free run can be predicted to the end of the record."""
    return len(comparison.t) > 0 and comparison.horizon_s >= comparison.t[-1]


def _verdict(used: float, held_out: Sequence[float]) -> str:
    if not math.isfinite(used):
        return "The noise floor is not known, so the residual says nothing about the model"
    if used > NOISE_LIKE.most:
        return f"The residual is {three(used)} times the noise floor: the model misses something"
    if not all(multiple <= NOISE_LIKE.most for multiple in held_out):
        return "Nothing is left but noise on the runs of the fit, yet the model does not carry over to others"
    if used < NOISE_LIKE.least:
        return f"The residual is {three(used)} times the noise floor: the floor is overstated, and so are the intervals"
    return "Nothing is left but noise"


def _held_out(multiples: Sequence[float]) -> str:
    if not multiples:
        return "no run held out"
    worst = f"{three(float(np.max(multiples)))} times the noise floor"
    return f"1 run held out: {worst}" if len(multiples) == 1 else f"{len(multiples)} runs held out: {worst} at worst"


def _worst(rms: Sequence[float] | NDArray[np.float64], noise: Sequence[float] | NDArray[np.float64]) -> float:
    return float(np.max(_times(np.asarray(rms), np.asarray(noise))))


def _times(rms: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Residual as a multiple of the noise floor, by axis; NaN where no floor is known."""
    return np.divide(rms, noise, out=np.full(len(rms), np.nan), where=noise > 0)


def _both(by_axis: dict[str, float], angles: AngleUnit) -> str:
    return f"{pair(angles.small_per_rad * value for value in by_axis.values())} {angles.small}"
