"""Create the tables of an identification: values with uncertainty and origin, and compared runs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import ALONE, RATIO_UNITS, RATIOS
from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import NONE, interval, pair, plus_minus, superscripts, three
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.run_names import compared_name
from dpr_lab.shown import FIXED_BY

if TYPE_CHECKING:
    from dpr_lab.identification.compare import Comparison
    from dpr_lab.identification.model import Model, ParameterValue
    from dpr_lab.identification.moving_arm.model import AnyModel
    from dpr_lab.planning.result import LimitForecast, Plan, PlannedRelease

RATIO_NOTE = (
    "a: inertia about joint 1; d: coupling of the rods; e1: gravity on joint 1; c1, c2: viscous friction of the joints."
    " All are divided by b, the inertia of the outer rod about joint 2."
)
RATIO_NOTE_ALONE = (
    "e1: gravity on joint 1; c1: viscous friction of joint 1. Both are divided by a, the inertia of the rod"
    " about joint 1."
)
BASE_TITLE = "Base parameters, because the scale is known"
SOURCE_NOTES = {
    "data": '"The recordings": they determine the value together with the known scale.',
    "measured": '"A measured value": the rig file states the value, for example of a scale or calliper.',
    "bound": (
        '"Only its bounds": these runs do not identify the parameter, and its 90 % interval uses the bounds of the rig'
        " file as a prior. A measurement of the parameter would determine it."
    ),
}
"""Explanation of each source of a parameter value."""
COMPARISON_NOTE = (
    "Pairs are θ1, θ2 (inner, outer rod). rms: residual of segments of 0.5 s with free initial states. Free run: rms"
    " error of one simulation from the release to the horizon. Held out: not fitted. Horizon: time up to"
    " which the swing is predictable; ≥: it is predictable up to the end of the recording."
)

BASE_UNITS = {
    "a": ("kg m²", "inertia about joint 1, with the mounted masses at joint 2"),
    "b": ("kg m²", "inertia of the outer rod about joint 2"),
    "d": ("kg m²", "coupling of the rods"),
    "e1": ("N m", "gravity on joint 1"),
    "c1": ("N m s/rad", "viscous friction of joint 1"),
    "c2": ("N m s/rad", "viscous friction of joint 2"),
}
PARAMETER_UNITS = {
    "l1": ("m", "inner rod, pivot to CoM"),
    "l2": ("m", "outer rod, pivot to CoM"),
    "m1": ("kg", "mass of the inner rod"),
    "m2": ("kg", "mass of the outer rod"),
    "mb": ("kg", "mass of the parts at joint 2"),
    "c1": ("N m s/rad", "viscous friction of joint 1"),
    "c2": ("N m s/rad", "viscous friction of joint 2"),
    "J1": ("kg m²", "inner rod, inertia about CoM"),
    "J2": ("kg m²", "outer rod, inertia about CoM"),
}


@dataclass(frozen=True, slots=True)
class NoiseLike:
    """Ratios of residual to noise floor at which the residual counts as noise.

    The noise floor is also an estimate. Without a rest before the release, this estimate is based on few samples.
    """

    least: float = 0.8
    """Minimum ratio. At a smaller ratio (squared: 0.64) the noise floor is overestimated."""
    most: float = 1.2
    """Maximum ratio. At a larger ratio (squared: 1.44) the model lacks an effect."""
    inflated: float = 1.5
    """Ratio of a standard deviation to its Cramér-Rao bound above which a note explains the difference."""


NOISE_LIKE = NoiseLike()

SMALL_EFFECTS = "Only rms values were compared. dpr-lab diagnose also detects effects that are smaller than the noise."


def summary(model: "Model", comparisons: "Sequence[Comparison]" = (), angles: AngleUnit = RADIANS) -> str:
    """State whether the rms residuals of the fitted and held-out runs are at the noise floor."""
    if model.failures:
        return f"Not reliable: {'; '.join(model.failures).rstrip('.')}."
    fitted = _worst(list(model.fit.rms_rad.values()), list(model.fit.noise_rad.values()))
    held_out = [_worst(c.segment_rms_rad, c.noise_rad) for c in comparisons if c.held_out]
    rods = 1 if model.fitted else 2
    residual, floor = (
        f"{pair(angles.small_per_rad * size for size in [*by_axis.values()][:rods])} {angles.small}"
        for by_axis in (model.fit.rms_rad, model.fit.noise_rad)
    )
    sizes = f"rms residual {', '.join(('θ1', 'θ2')[:rods])}: {residual}; noise floor: {floor}"
    if fitted > NOISE_LIKE.most and _driven_by_noise(fitted, model.fit.chi2_per_dof):
        verdict = (
            f"The residual is {three(fitted)} times the noise of the readings. Noise alone explains this"
            " residual, because the noise of the prescribed motion or of the measured torques also moves"
            f" the rods. With this noise, the reduced chi-square is {three(model.fit.chi2_per_dof)}"
        )
        return f"{verdict} ({sizes}; {_held_out(held_out)}). {SMALL_EFFECTS}"
    verdict = f"{_verdict(fitted, held_out)} ({sizes}; {_held_out(held_out)})."
    return f"{verdict} {SMALL_EFFECTS}" if fitted <= NOISE_LIKE.most else verdict


def ratio_title(model: "Model") -> str:
    """Return the title of the table of `ratio_table`."""
    if model.fitted:
        return "Ratios to the inertia a of the rod"
    if all(ratio.fixed_by == "data" for ratio in model.ratios.values()):
        return "Five ratios, which a free swing determines"
    return "Ratios to the inertia b of the outer rod"


@page_table("ratio", "value ± std", "90 % interval", "unit")
def ratio_table(model: "AnyModel") -> Rows:
    """Return one row for each ratio that the recordings determine."""
    return [
        [
            name,
            plus_minus(ratio.value, ratio.std),
            interval(*ratio.interval90, ratio.value, ratio.std),
            superscripts(RATIO_UNITS.get(name, "")),
        ]
        for name, ratio in model.ratios.items()
        if ratio.fixed_by == "data"
    ]


@page_table("quantity", "undecided range", "unit", "decidable after the plan")
def limit_forecast_table(made: "Plan") -> Rows:
    """Return one row for each limit that a plan tests."""
    return [
        (
            limit.quantity,
            "" if limit.reach is None else f"{limit.reach:.2g}",
            limit.unit,
            "yes" if limit.decides else limit.unknown or f"no{_obstacle(limit)}",
        )
        for limit in made.limits
    ]


def _obstacle(limit: "LimitForecast") -> str:
    """Return the reason why a limit stays undecided; empty if the recordings are not accurate enough."""
    if limit.all_shapes:
        return ": the interval covers all shapes of the effect"
    return "" if limit.reached_rad_per_s is None else f": the joint reaches {limit.reached_rad_per_s:.3g} rad/s"


@page_table("ratio", "now", "after the plan", "unit")
def ratio_std_table(made: "Plan", release: "PlannedRelease") -> Rows:
    """Return the standard deviation of each ratio now and after a planned release.

    Before any recording, the rig file bounds only the ratios of the rods. The ratios of arm and drive are unknown.
    """
    return [
        (
            name,
            "unknown" if made.state == "first" and name not in (*RATIOS, *ALONE) else f"{std:.2g}",
            f"{release.ratio_std[name]:.2g}",
            superscripts(RATIO_UNITS[name]),
        )
        for name, std in made.ratio_std.items()
    ]


def _undetermined(model: "Model") -> str:
    """Describe the ratios that the recordings do not determine; empty for none."""
    names = [name for name, ratio in model.ratios.items() if ratio.fixed_by != "data"]
    names += ["the ratios of the outer rod, which is not mounted"] if model.fitted else []
    return f" Not determined by these recordings: {', '.join(names)}." if names else ""


def ratio_note(model: "Model") -> str:
    """Describe the ratios, and explain standard deviations that clearly exceed those of `identifiability`."""
    noise_and_misfit = math.sqrt(max(1.0, model.fit.chi2_per_dof))
    inflation = [
        ratio.std / (noise_and_misfit * bound)
        for name, ratio in model.ratios.items()
        if ratio.fixed_by == "data" and (bound := model.cramer_rao_std.get(name, 0.0)) > 0
    ]
    meaning = RATIO_NOTE_ALONE if model.fitted else RATIO_NOTE
    if not inflation or max(inflation) < NOISE_LIKE.inflated:
        return meaning + _undetermined(model)
    return (
        f"{meaning} The standard deviations include misfit inflation, because the residuals are correlated in time:"
        f" they are up to {three(max(inflation))} times the Cramér-Rao values that `identifiability` prints for"
        f" independent residuals.{_undetermined(model)}"
    )


@page_table("base parameter", "value ± std", "unit", "meaning")
def base_table(model: "Model") -> Rows:
    """Return one row for each base parameter of the mounted rods; empty if the scale is not known."""
    base = model.alone or model.base
    if base["a" if model.alone else "b"].fixed_by != "data":
        return []
    return [[name, plus_minus(value.value, value.std), *BASE_UNITS[name]] for name, value in base.items()]


@page_table("parameter", "value ± std", "90 % interval", "unit", "determined by", "meaning")
def parameter_table(model: "Model") -> Rows:
    """Return one row for each physical parameter of the mounted parts."""
    rows: list[list[str]] = []
    for name, parameter in model.mounted.items():
        unit, meaning = PARAMETER_UNITS.get(name, ("", ""))
        value = plus_minus(parameter.value, parameter.std)
        rows.append([name, value, interval_words(parameter), unit, FIXED_BY[parameter.fixed_by], meaning])
    return rows


def interval_words(parameter: "ParameterValue") -> str:
    """Format the 90 % interval of a parameter.

    The standard deviation, or else the half width, determines the number of decimals.
    """
    if parameter.interval90 is None:
        return NONE
    low, high = parameter.interval90
    return interval(low, high, parameter.value, parameter.std or (high - low) / 2)


def parameter_note(model: "Model") -> str:
    """Describe the sources of the parameter values, and the scale of absolute values."""
    sources = {parameter.fixed_by for parameter in model.mounted.values()}
    notes = [note for source, note in SOURCE_NOTES.items() if source in sources]
    return " ".join([*notes, *([superscripts(model.scale_sentence)] if model.scale else [])])


def role(held_out: bool, truncated: bool) -> str:
    """Return the role of a recording, and whether it is truncated."""
    return ("held out" if held_out else "fitted") + (", truncated" if truncated else "")


@page_table(
    "run",
    "role",
    "segments",
    "rms (mrad)",
    "noise (mrad)",
    "rms / noise",
    "free run (mrad)",
    "horizon (s)",
    caption=COMPARISON_NOTE,
)
def comparison_table(comparisons: "Sequence[Comparison]", angles: AngleUnit = RADIANS) -> Rows:
    """Return one row for each compared run."""
    return [
        [
            compared_name(comparison),
            role(comparison.held_out, comparison.truncated)
            + (f", {comparison.torque_kind} torques" if comparison.torque_kind else ""),
            str(comparison.segments),
            pair(angles.small_per_rad * comparison.segment_rms_rad[:rods]),
            pair(angles.small_per_rad * comparison.noise_rad[:rods]),
            pair(_noise_ratio(comparison.segment_rms_rad, comparison.noise_rad)[:rods]),
            pair(angles.small_per_rad * comparison.free_run_rms_rad[:rods]),
            ("≥ " if to_the_end(comparison) else "") + three(comparison.horizon_s),
        ]
        for comparison in comparisons
        for rods in [comparison.rods]
    ]


@page_table("file", "pose", "samples", "duration (s)", "segments", "χ² per dof", "SHA-256", style="hash")
def run_table(model: "Model") -> Rows:
    """Return one row for each fitted run."""
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
    """Format fitted zero offsets of rezeroed encoders; empty without offsets."""
    return f", zero offsets {' and '.join(f'{1e3 * zero:.3g}' for zero in fitted)} mrad" if fitted else ""


@page_table("quantity", "value", style="prose")
def search_table(model: "Model") -> Rows:
    """Return the settings that are needed to repeat a search, followed by its result."""
    from dpr_lab.identification.objectives import objective_words
    from dpr_lab.search import search_words

    search, fit = model.search, model.fit
    settings = f"{search_words(search.algorithm)}, objective {objective_words(search.objective)}, seed {search.seed}"
    best = ", ".join(f"{name} = {value:.4g}" for name, value in search.best.items())
    return [
        ["search", settings],
        ["generations", str(search.generations)],
        ["evaluations", str(search.evaluations)],
        ["time", f"{three(search.seconds)} s"],
        ["cost of the best individual", f"{search.best_cost:.4g}"],
        ["best individual before the local solver", best or NONE],
        ["local solver", f"{fit.iterations} iterations, {fit.segments} segments up to {fit.longest_segment_s:.3g} s"],
        ["χ² per degree of freedom", f"{three(fit.chi2_per_dof)} (1 = noise alone)"],
    ]


def to_the_end(comparison: "Comparison") -> bool:
    """Check whether the predictability horizon is at or after the end of the record."""
    return len(comparison.t) > 0 and comparison.horizon_s >= comparison.t[-1]


def _verdict(fitted: float, held_out: Sequence[float]) -> str:
    if not math.isfinite(fitted):
        return "The noise floor is unknown, so the residual cannot be judged"
    if fitted > NOISE_LIKE.most:
        return (
            f"The residual is {three(fitted)} times the noise floor: the model lacks an effect, or the noise floor is"
            " underestimated. dpr-lab diagnose tests both"
        )
    if not all(multiple <= NOISE_LIKE.most for multiple in held_out):
        return "The residual of the fitted runs is at the noise floor; the residual of the held-out runs is larger"
    if fitted < NOISE_LIKE.least:
        return f"The residual is {three(fitted)} times the noise floor, so noise floor and intervals are overestimated"
    return "The residual is at the noise floor"


def _driven_by_noise(fitted: float, chi2_per_dof: float) -> bool:
    """Check whether noise of the known motion or torques explains the residual.

    `fitted` is the ratio of the residual to the noise of the readings, at the joint with the larger ratio. Without
    noise of the motion or torques, the reduced chi-square would be the mean of the squared ratios of both joints.
    """
    return chi2_per_dof < min(NOISE_LIKE.most**2, 0.5 * fitted**2)


def _held_out(multiples: Sequence[float]) -> str:
    if not multiples:
        return "no run held out"
    worst = f"{three(float(np.max(multiples)))} times the noise floor"
    return f"1 run held out: {worst}" if len(multiples) == 1 else f"{len(multiples)} runs held out: at most {worst}"


def _worst(rms: Sequence[float] | Array, noise: Sequence[float] | Array) -> float:
    return float(np.max(_noise_ratio(np.asarray(rms), np.asarray(noise))))


def _noise_ratio(rms: Array, noise: Array) -> Array:
    """Divide residual by noise floor for each axis; NaN without a noise floor."""
    return np.divide(rms, noise, out=np.full(len(rms), np.nan), where=noise > 0)
