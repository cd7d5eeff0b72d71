"""Show the area validation metric: a comparison of the angle distributions within the predictability horizon."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Curves
from dpr_lab.report import style
from dpr_lab.report.digits import three
from dpr_lab.report.figures import legend_above, new_figure
from dpr_lab.report.gap.section import EvidenceSection, evidence_of
from dpr_lab.report.gap.tables import run_words
from dpr_lab.report.pages.page import Rows, page_table

RODS = ("inner rod", "outer rod")


def metric_figure(diagnosis: Diagnosis) -> Figure | None:
    """Draw differences of quantiles for the recording in which the bare model has the largest area metric.

    The result is None if no recording was simulated.
    """
    evidence = evidence_of(diagnosis)
    if not evidence.curves:
        return None
    worst = max(evidence.budget.runs, key=lambda run: run.area_before_rad).run
    curves = next(curves for curves in evidence.curves if curves.run == worst)
    figure = new_figure(3.2)
    for column, axes in enumerate(figure.subplots(1, curves.rods, squeeze=False)[0]):
        _draw_quantiles(axes, curves, column)
    legend_above(figure)
    return figure


def _draw_quantiles(axes: Axes, curves: Curves, column: int) -> None:
    t = np.array(curves.t_s)
    compared = (t >= curves.settled_s) & (t <= curves.until_s)
    measured, *simulated = (
        np.sort(np.array(angles)[compared, column])
        for angles in (curves.measured_rad, curves.before_rad, curves.after_rad)
    )
    probability = (np.arange(compared.sum()) + 0.5) / max(compared.sum(), 1)
    axes.axhline(0.0, **style.ZERO)
    for (label, line), quantiles in zip(style.MODELS.values(), simulated, strict=True):
        difference = 1e3 * (quantiles - measured)
        axes.fill_between(probability, 0.0, difference, color=line["color"], alpha=0.25, linewidth=0)
        axes.plot(probability, difference, label=label, **line)
    axes.set(title=f"{RODS[column]}, {run_words(curves.run)}", xlabel="cumulative probability")
    axes.set_ylabel("quantile of the angle,\nsimulated − measured (mrad)")
    axes.margins(x=0.01)


def metric_words(diagnosis: Diagnosis) -> list[str]:
    """Describe the mean area metrics and the predictability horizons."""
    runs = evidence_of(diagnosis).budget.runs
    if not runs:
        return ["No recording was simulated."]
    bare, corrected, noise = (
        1e3 * float(np.mean([getattr(run, f"area_{name}_rad") for run in runs]))
        for name in ("before", "after", "noise")
    )
    cut = [run for run in runs if run.reaches_horizon]
    shortest = f"{min(run.until_s for run in runs):.2g} s"
    horizon = (
        f"{len(cut)} of {len(runs)} free runs reach their predictability horizon, the first after {shortest}. Later"
        " angles are not compared."
        if cut
        else f"No free run reaches its predictability horizon within the {shortest} that are compared."
    )
    return [
        "The metric is the area between the distributions of the measured and of the simulated angles. Its"
        f" unit is an angle, and it is zero if the distributions agree. Mean area: {three(bare)} mrad for"
        f" the bare model, {three(corrected)}"
        f" mrad for the corrected model, {three(noise)} mrad expected from noise alone.",
        f"Errors of the initial state grow with time. {horizon}",
    ]


@page_table(
    "run",
    "horizon (s)",
    "growth rate of errors (1/s)",
    "area, bare model (mrad)",
    "area, corrected model (mrad)",
    "area, noise alone (mrad)",
    caption="Horizon: time at which the uncertainty of the initial state alone moves an angle by 0.1 rad; ≥"
    " if this time is beyond the free run of 2.6 s. Growth rate: largest finite-time Lyapunov"
    " exponent of the angles up to the horizon. Areas: mean of the joints.",
    style="prose",
    title="Areas and horizons by run",
)
def metric_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each free run, with horizon and area metric."""
    return [
        (
            run_words(run.run, run.held_out),
            f"{'' if run.reaches_horizon else '≥ '}{run.until_s:.2f}",
            three(run.growth_per_s),
            *(three(1e3 * area) for area in (run.area_before_rad, run.area_after_rad, run.area_noise_rad)),
        )
        for run in evidence_of(diagnosis).budget.runs
    ]


METRIC = EvidenceSection(
    name="metric",
    title="Validation metric and predictability",
    words=metric_words,
    figure=metric_figure,
    alternative="Differences of the quantiles of simulated and measured angles of the rods, for both models.",
    caption="Differences of the quantiles of simulated and measured angles within the horizon, for the recording in"
    " which the bare model has the largest area. The shaded areas are the metric.",
    tables=(metric_table,),
    symbols="d = ∫ |F_S(x) − F_D(x)| dx = ∫ |x_S(p) − x_D(p)| dp, with the empirical distributions F_S (simulation) and"
    " F_D (data). Source: Ferson, Oberkampf & Ginzburg (2008), Comput. Methods Appl. Mech. Engrg. 197, 2408-2430.",
)
