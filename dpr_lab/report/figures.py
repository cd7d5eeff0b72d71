"""Figures of an identification: response, error with noise floor, search.

The figures correspond to figures 2 to 4 of the publication (docs/theory.md).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, MultipleLocator
from numpy.typing import NDArray
from PIL import Image

from dpr_lab.arrays import Array
from dpr_lab.errors import DprError
from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.identify import JOINTS_READ, AnyComparison, ArmComparison
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.report import style
from dpr_lab.report.digits import three
from dpr_lab.report.envelope import signal_scale, trace
from dpr_lab.report.run_names import compared_name, run_label
from dpr_lab.report.tables import to_the_end
from dpr_lab.run import Run
from dpr_lab.search import search_words
from dpr_lab.whole_file import write_whole

AXES = ("inner rod θ₁", "outer rod θ₂")
NOISE_SIGMAS = 2
"""Half height of the noise band, in standard deviations."""
NO_COMPARISON = "No run was compared."

Compared: TypeAlias = AnyComparison | Sequence[AnyComparison]
"""One or several comparisons, either all with a clamped arm or all with a moving arm."""

_EVOLUTION = {
    "best_cost": "cost of the best\nindividual",
    "best_fitness": "fitness of the\nbest individual",
    "population_fitness": "population\nfitness",
}


def draw_with_intervals(axes: Axes, x: Array, values: Array, half_widths: Array, **line: Any) -> None:
    """Draw a curve with its 90 % intervals.

    The y axis is limited to the range of typical intervals. If it clips larger intervals, the panel states this.
    """
    low, high = values - half_widths, values + half_widths
    axes.fill_between(x, low, high, label="90 % interval", color=line["color"], alpha=0.25, linewidth=0)
    axes.plot(x, values, **line)
    axes.axhline(0.0, **style.ZERO)
    scale, clipped = signal_scale(values, half_widths)
    axes.set_ylim(*scale)
    if clipped:
        axes.annotate("clipped", (0.01, 0.02), xycoords="axes fraction", fontsize="small")


def run_figure(run: Run) -> Figure:
    """Draw measured angles against the time since the release.

    For a moving arm, the angle of the arm and the input of its drive are drawn as well.
    """
    further = [("arm (rad)", run.theta[:, 0])] if run.arm_mode != "clamped" else []
    further += [("input of the arm (SI)", run.arm_input)] if run.arm_input is not None else []
    names = ("rod",) if run.mounting in ("inner", "outer") else ("inner rod", "outer rod")
    with style.house_style():
        figure = new_figure(3.2 + 1.4 * len(further))
        heights = [2.0, *([1.0] * len(further))]
        panels = figure.subplots(len(heights), squeeze=False, sharex=True, height_ratios=heights)[:, 0]
        for rod, name in enumerate(names, 1):
            panels[0].plot(run.t, run.theta[:, rod], label=name)
        _angle_range(panels[0], run.theta[:, 1 : 1 + len(names)])
        panels[0].set_ylabel("angle (rad, 0 = upright)")
        panels[0].set_title(_one_line(run_label(run.name)), parse_math=False)
        for axes, (name, values) in zip(panels[1:], further, strict=True):
            axes.plot(run.t, values)
            axes.set_ylabel(name)
        for axes in panels:
            axes.margins(x=0.01)
        panels[-1].set_xlabel("time since the release (s)")
        figure.align_ylabels(panels)
        legend_above(figure)
        return figure


def response_figure(comparisons: Compared) -> Figure:
    """Draw measured and simulated angles of both rods, one row per run.

    This is figure 2 of the publication. The free run is a strong line up to the predictability horizon and a faint line
    beyond it. The axis range is that of the measured angles, so that a diverging free run leaves the panel. With a
    moving arm, there is one row for each pair of a run and a joint.
    """
    arms, comparisons = by_kind(comparisons)
    if arms:
        return _arm_response(arms)
    with style.house_style():
        if not comparisons:
            return empty_figure(NO_COMPARISON)
        figure = new_figure(0.5 + 1.75 * len(comparisons))
        rods = max(comparison.rods for comparison in comparisons)
        grid = figure.subplots(len(comparisons), rods, squeeze=False)
        for panels, comparison in zip(grid, comparisons, strict=True):
            _title(panels[0], comparison)
            for axis, axes in enumerate(panels[: comparison.rods]):
                _draw_response(axes, comparison, axis)
            for unused in panels[comparison.rods :]:
                unused.axis("off")
        for axes in grid[-1]:
            axes.set_xlabel("time since release (s)")
        legend_above(figure)
        return figure


def error_figure(comparisons: Compared) -> Figure:
    """Draw errors and residuals of each run, mrad (figure 3 of the publication).

    The left panels show the error of the free run up to the horizon. The right panels show the residual of segments
    with fitted initial states. The panels of the inner rod are above those of the outer rod. With a moving arm, the
    residual of each run and joint is drawn.
    """
    arms, comparisons = by_kind(comparisons)
    if arms:
        return _arm_errors(arms)
    with style.house_style():
        if not comparisons:
            return empty_figure(NO_COMPARISON)
        rows = [0, *np.cumsum([comparison.rods for comparison in comparisons]).tolist()]
        figure = new_figure(0.5 + 1.35 * rows[-1])
        grid = figure.subplots(rows[-1], 2, squeeze=False)
        for (first, end), comparison in zip(pairwise(rows), comparisons, strict=True):
            _draw_errors(grid[first:end], comparison)
        legend_above(figure)
        return figure


def by_kind(comparisons: Compared) -> tuple[list[ArmComparison], list[Comparison]]:
    """Separate comparisons with a moving arm from comparisons with a clamped arm."""
    every = [comparisons] if isinstance(comparisons, AnyComparison) else list(comparisons)
    arms = [comparison for comparison in every if isinstance(comparison, ArmComparison)]
    return arms, [comparison for comparison in every if isinstance(comparison, Comparison)]


def _panels(runs: Sequence[ArmComparison]) -> tuple[Figure, list[tuple[Any, ArmComparison, int]]]:
    """Create a figure with one panel per run and joint with readings."""
    rows = [(run, joint) for run in runs for joint, name in enumerate(JOINTS_READ) if name in run.rms_rad]
    figure = new_figure(0.6 + 1.5 * len(rows))
    panels = figure.subplots(len(rows), squeeze=False)[:, 0]
    rows_of_axes = [(axes, run, joint) for axes, (run, joint) in zip(panels, rows, strict=True)]
    for axes, run, joint in rows_of_axes:
        if joint == 0 or JOINTS_READ[0] not in run.rms_rad:
            axes.set_title(_one_line(run_label(run.run)), parse_math=False)
        axes.set_xlim(float(run.t[0]), float(run.t[-1]))
    panels[-1].set_xlabel("time since the release (s)")
    return figure, rows_of_axes


def _arm_response(runs: Sequence[ArmComparison]) -> Figure:
    with style.house_style():
        figure, panels = _panels(runs)
        for axes, run, joint in panels:
            axes.plot(*trace(run.t, run.measured[:, joint]), label="measured", **style.MEASURED)
            axes.plot(*trace(run.t, run.simulated[:, joint]), label="simulated", **style.SIMULATED)
            axes.set_ylabel(f"{JOINTS_READ[joint]} (rad)")
        legend_above(figure)
        return figure


def _arm_errors(runs: Sequence[ArmComparison]) -> Figure:
    with style.house_style():
        figure, panels = _panels(runs)
        for axes, run, joint in panels:
            residual = run.measured[:, joint] - run.simulated[:, joint]
            _draw_error(axes, run.t, residual, run.noise_rad[JOINTS_READ[joint]])
            axes.set_ylabel(f"{JOINTS_READ[joint]} (mrad)")
        legend_above(figure)
        return figure


def evolution_figure(model: AnyModel) -> Figure:
    """Draw cost and fitness of the search against the generations (figure 4 of the publication).

    Raises:
        DprError: the model has a moving arm; its fit starts from the rig file, without a search.
    """
    if isinstance(model, MovingArmModel):
        raise DprError("a model of a moving arm has no search to plot: its fit starts from the rig file")
    with style.house_style():
        figure = new_figure(5.0)
        grid = figure.subplots(3, 1, sharex=True, height_ratios=(2, 1, 1))
        for axes, (column, label) in zip(grid, _EVOLUTION.items(), strict=True):
            values = model.search.history.get(column, [])
            axes.plot(np.arange(len(values)), values, label=column, drawstyle="steps-post", **style.EVOLUTION)
            axes.set_ylabel(label)
            axes.margins(x=0.01, y=0.12)
            side = "right" if column == "best_cost" else "left"
            _note(axes, f"last: {values[-1]:.4g}" if values else "not recorded", side)
        if any(cost > 0 for cost in model.search.history.get("best_cost", [])):
            grid[0].set_yscale("log")
        grid[0].set_title(
            f"{_one_line(search_words(model.search.algorithm))}, seed {model.search.seed}", parse_math=False
        )
        grid[-1].xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
        grid[-1].set_xlabel("generation")
        figure.align_ylabels(grid)
        return figure


def save_figures(model: Model, comparisons: Sequence[Comparison], out_dir: Path) -> dict[str, Path]:
    """Write `response.png`, `error.png` and `evolution.png`.

    Returns:
        path of each file by the name of its figure: response, error, evolution

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = {
        "response": response_figure(comparisons),
        "error": error_figure(comparisons),
        "evolution": evolution_figure(model),
    }
    return save_each(figures, out_dir)


def save_each(figures: Mapping[str, Figure], out_dir: Path) -> dict[str, Path]:
    """Write figures as PNG files, and return their paths by name.

    Raises:
        DprError: the folder or a file cannot be written.
    """
    paths = {name: out_dir / f"{name}.png" for name in figures}
    for name, path in paths.items():
        write_whole(path, lambda file, figure=figures[name]: save_png(figure, file))
    return paths


def save_png(figure: Figure, path: Path) -> None:
    """Save a figure as a small PNG file."""
    canvas = FigureCanvasAgg(figure)
    with style.house_style(), warnings.catch_warnings():
        # Missing characters of the font are drawn as boxes; the tables contain the full name.
        warnings.filterwarnings("ignore", message="Glyph .* missing")
        canvas.draw()
    # A palette reduces the files to a third without a visible change of colours; the octree finds it in a tenth of the
    # time of the median cut, with smaller largest errors.
    rgb = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    picture = rgb.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    picture.save(path, format="PNG", dpi=(style.DPI, style.DPI))


def new_figure(height_in: float) -> Figure:
    """Create an empty figure of the common width."""
    figure = Figure(figsize=(style.WIDTH_IN, height_in))
    figure.set_layout_engine("constrained", wspace=0.03, hspace=0.02)
    return figure


def empty_figure(sentence: str) -> Figure:
    """Create a figure that shows a sentence instead of data."""
    figure = new_figure(1.2)
    figure.text(0.5, 0.5, sentence, ha="center", va="center")
    return figure


def _draw_response(axes: Axes, comparison: Comparison, axis: int) -> None:
    t, measured, free = comparison.t, comparison.measured[:, axis], comparison.free_run[:, axis]
    near = t <= comparison.horizon_s
    # A shared sample connects the faint line to the strong line.
    far = t >= t[near][-1] if near.any() else ~near
    axes.plot(*trace(t, measured), label="measured", **style.MEASURED)
    axes.plot(*trace(t[near], free[near]), label="simulated, free run", **style.SIMULATED)
    if not near.all():
        axes.plot(*trace(t[far], free[far]), label="beyond the horizon", **style.BEYOND)
        axes.axvline(comparison.horizon_s, label="predictability horizon", **style.HORIZON)
    axes.set_ylabel(f"{AXES[axis]} (rad)")
    _angle_range(axes, np.concatenate([measured, free[near]]))
    _time_range(axes, t)


def _draw_errors(panels: NDArray[np.object_], comparison: Comparison) -> None:
    """Draw the error panels (rods, 2) of one run."""
    near = comparison.t <= comparison.horizon_s
    _title(panels[0, 0], comparison)
    for axis, (left, right) in enumerate(panels):
        noise = float(comparison.noise_rad[axis])
        free, segment = comparison.free_run_error[:, axis], comparison.segment_residual[:, axis]
        _draw_error(left, comparison.t[near], free[near], noise, float(comparison.free_run_rms_rad[axis]))
        _draw_error(right, comparison.t, segment, noise, float(comparison.segment_rms_rad[axis]))
        left.set_ylabel(f"{AXES[axis]}\nerror (mrad)")
        right.set_ylabel("residual (mrad)")
    for left, right in panels[:-1]:
        left.tick_params(labelbottom=False)
        right.tick_params(labelbottom=False)
    panels[-1, 0].set_xlabel("free run up to the horizon: time since release (s)")
    panels[-1, 1].set_xlabel("segments with free initial states: time since release (s)")


def _draw_error(axes: Axes, t: Array, error: Array, noise_rad: float, rms_rad: float = np.nan) -> None:
    band = NOISE_SIGMAS * 1e3 * noise_rad
    axes.axhspan(-band, band, label=f"noise floor, ±{NOISE_SIGMAS}σ", **style.NOISE_BAND)
    axes.plot(*trace(t, 1e3 * error), label="measured − simulated", **style.RESIDUAL)
    if np.isfinite(rms_rad):
        _note(axes, f"rms {three(1e3 * rms_rad)} mrad")
    _symmetric_range(axes, np.append(1e3 * error, 1.2 * band))
    _time_range(axes, t)


def _title(axes: Axes, comparison: Comparison) -> None:
    role = "held out" if comparison.held_out else "fitted"
    horizon = "predictable to the end" if to_the_end(comparison) else f"horizon {comparison.horizon_s:.2g} s"
    axes.set_title("   |   ".join((_one_line(compared_name(comparison)), role, horizon)), parse_math=False)


def _one_line(name: str, longest: int = 70) -> str:
    """Clean a name from a file for a title.

    The result has no line breaks, no lone surrogates, and at most `longest` characters.
    """
    line = " ".join(name.encode("utf-8", "replace").decode().split())
    return line if len(line) <= longest else f"{line[: longest - 1]}…"


def _note(axes: Axes, text: str, side: Literal["left", "right"] = "left") -> None:
    x = {"left": 0.01, "right": 0.99}[side]
    axes.text(x, 0.97, text, transform=axes.transAxes, ha=side, va="top", fontsize=8, zorder=5, bbox=style.NOTE_BOX)


def legend_above(figure: Figure) -> None:
    """Draw one common legend above all panels."""
    handles = {str(h.get_label()): h for axes in figure.axes for h in axes.get_legend_handles_labels()[0]}
    figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=len(handles))


def _time_range(axes: Axes, t: Array) -> None:
    if len(t) > 1:
        axes.set_xlim(float(t[0]), float(t[-1]))


def _symmetric_range(axes: Axes, values: Array) -> None:
    largest = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
    if largest > 0:
        axes.set_ylim(-1.1 * largest, 1.1 * largest)


def _angle_range(axes: Axes, values: Array) -> None:
    """Set the axis range for angles, rad; ticks are at multiples of π/2 if the angles span more than π."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return
    low, high = float(finite.min()), float(finite.max())
    margin = 0.06 * max(high - low, 0.1)
    axes.set_ylim(low - margin, high + margin)
    if high - low > np.pi:
        step = next(step for k in range(64) if (high - low) / (step := np.pi / 2 * 2**k) <= 4)
        axes.yaxis.set_major_locator(MultipleLocator(step))
        axes.yaxis.set_major_formatter(FuncFormatter(_multiple_of_pi))


def _multiple_of_pi(value: float, _position: int | None = None) -> str:
    halves = Fraction(round(2 * value / np.pi), 2)
    if halves == 0:
        return "0"
    sign = "−" if halves < 0 else ""
    times = "" if abs(halves.numerator) == 1 else str(abs(halves.numerator))
    return f"{sign}{times}π" + ("" if halves.denominator == 1 else "/2")
