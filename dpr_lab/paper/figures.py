"""Figures 2 to 4 of the publication, for the repeated search."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.paper.campaign import TRUTHS, SearchResult
from dpr_lab.paper.printed import POSES
from dpr_lab.paper.swings import INSTANTS, swings
from dpr_lab.report import style
from dpr_lab.report.figures import AXES
from dpr_lab.rig import Rig
from dpr_lab.whole_file import write_whole


def response_figure(search: SearchResult, rig: Rig) -> Figure:
    """Draw figure 2: angles with true and identified parameters, one row per pose."""
    true, ours = swings(TRUTHS[search.case.grid], rig), swings(search.best, rig)

    def draw(axes: Axes, pose: int, axis: int) -> None:
        axes.plot(INSTANTS, true[pose, :, axis], label="true parameters", **style.MEASURED)
        axes.plot(INSTANTS, ours[pose, :, axis], label="identified parameters", **style.SIMULATED)

    return _by_pose("angle (rad)", draw)


def error_figure(search: SearchResult, rig: Rig) -> Figure:
    """Draw figure 3: the difference between the angles of figure 2."""
    error = swings(TRUTHS[search.case.grid], rig) - swings(search.best, rig)

    def draw(axes: Axes, pose: int, axis: int) -> None:
        axes.plot(INSTANTS, error[pose, :, axis], label="true − identified", **style.RESIDUAL)

    return _by_pose("error (rad)", draw)


def evolution_figure(search: SearchResult) -> Figure:
    """Draw figure 4: H and fitness of the best individual in each generation."""
    with style.house_style():
        figure = _new_figure(4.2)
        upper, lower = figure.subplots(2, 1, sharex=True)
        generations = np.arange(search.generations + 1)
        upper.plot(generations, search.history["best_cost"], drawstyle="steps-post", **style.EVOLUTION)
        lower.plot(generations, search.history["best_fitness"], drawstyle="steps-post", **style.EVOLUTION)
        upper.set_yscale("log")
        upper.set_ylabel("H of the best")
        lower.set_ylabel("fitness of the best")
        lower.set_xlabel("generation")
        case = search.case
        upper.set_title(f"H = {case.reading}, true values {case.grid} the grid, seed {case.seed}")
        return figure


def save_figures(search: SearchResult, rig: Rig, out_dir: Path) -> dict[str, Path]:
    """Write `figure2.png`, `figure3.png` and `figure4.png`.

    Returns:
        paths of the figures by name, in the order of `dpr_lab.paper.printed.FIGURES`

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = {
        "figure2": response_figure(search, rig),
        "figure3": error_figure(search, rig),
        "figure4": evolution_figure(search),
    }
    paths = {name: out_dir / f"{name}.png" for name in figures}
    for name, figure in figures.items():
        with style.house_style():
            write_whole(paths[name], lambda file, figure=figure: figure.savefig(file))
    return paths


def _by_pose(label: str, draw: Callable[[Axes, int, int], None]) -> Figure:
    with style.house_style():
        figure = _new_figure(0.5 + 1.75 * len(POSES))
        grid = figure.subplots(len(POSES), 2, sharex=True, squeeze=False)
        for pose, panels in enumerate(grid):
            panels[0].set_title(f"pose {POSES[pose]}")
            for axis, axes in enumerate(panels):
                draw(axes, pose, axis)
                axes.set_ylabel(f"{AXES[axis]}\n{label}")
        for axes in grid[-1]:
            axes.set_xlabel("time since release (s)")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(handles))
        return figure


def _new_figure(height_in: float) -> Figure:
    figure = Figure(figsize=(style.WIDTH_IN, height_in))
    figure.set_layout_engine("constrained")
    return figure
