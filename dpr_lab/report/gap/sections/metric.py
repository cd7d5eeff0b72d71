"""How alike the distributions of measured and simulated angles are, as far as a swing can be predicted."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Curves
from dpr_lab.report import style
from dpr_lab.report.digits import three
from dpr_lab.report.figures import empty_figure, legend_above, new_figure
from dpr_lab.report.gap.section import EvidenceSection, FoldedTable, evidence_of
from dpr_lab.report.gap.tables import run_words

RODS = ("inner rod", "outer rod")


def metric_figure(diagnosis: Diagnosis) -> Figure:
    """Quantiles of the recording with the largest area before."""
    told = evidence_of(diagnosis)
    with style.house_style():
        if not told.curves:
            return empty_figure("no recording was simulated")
        worst = max(told.budget.runs, key=lambda run: run.area_before_rad).run
        curves = next(item for item in told.curves if item.run == worst)
        figure = new_figure(3.2)
        for column, axes in enumerate(figure.subplots(1, 2)):
            _draw_quantiles(axes, curves, column)
        legend_above(figure)
        return figure


def _draw_quantiles(axes: Axes, curves: Curves, column: int) -> None:
    t = np.array(curves.t_s)
    own = (t >= curves.settled_s) & (t <= curves.until_s)
    values = {
        "measured": curves.measured_rad,
        "before the effects": curves.before_rad,
        "after the effects": curves.after_rad,
    }
    sorted_of = {name: np.sort(np.array(item)[own, column]) for name, item in values.items()}
    share = (np.arange(own.sum()) + 0.5) / max(own.sum(), 1)
    axes.axhline(0.0, color="#555555", linewidth=0.8)
    for name, look in (("before the effects", style.SIMULATED), ("after the effects", style.RESIDUAL)):
        off = 1e3 * (sorted_of[name] - sorted_of["measured"])
        axes.fill_between(share, 0.0, off, color=look["color"], alpha=0.25, linewidth=0)
        axes.plot(share, off, label=name, **look)
    axes.set(title=f"{RODS[column]}, {run_words(curves.run)}", xlabel="share of the time below the angle")
    axes.set_ylabel("quantile of the angle,\nsimulated − measured (mrad)")
    axes.margins(x=0.01)


def metric_words(diagnosis: Diagnosis) -> list[str]:
    """The areas in words, and where they end."""
    runs = evidence_of(diagnosis).budget.runs
    if not runs:
        return ["No recording was simulated."]
    before, after, noise = (
        1e3 * float(np.mean([getattr(run, f"area_{name}_rad") for run in runs]))
        for name in ("before", "after", "noise")
    )
    lost = [run for run in runs if run.reaches_horizon]
    ends = f"{min(run.until_s for run in runs):.2g} s"
    within = (
        f"{len(lost)} of {len(runs)} free runs are cut at their horizon, the first after {ends}."
        if lost
        else f"All are predictable over the whole {ends} that are compared."
    )
    return [
        "How long were the rods at which angle, measured and simulated? The area between the two distributions is"
        " zero where"
        f" they agree, and is an angle. On average it is {three(before)} mrad before, {three(after)} mrad after the"
        f" named"
        f" effects; noise alone would leave {three(noise)} mrad.",
        f"Small errors of a start grow until they drown what the model does: {within} Beyond the horizon nothing is"
        f" compared.",
    ]


def metric_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Areas and horizons of all free runs."""
    return [
        (
            run_words(run.run, run.held_out),
            f"{'' if run.reaches_horizon else '≥ '}{run.until_s:.2f}",
            three(run.growth_per_s),
            *(three(1e3 * value) for value in (run.area_before_rad, run.area_after_rad, run.area_noise_rad)),
        )
        for run in evidence_of(diagnosis).budget.runs
    ]


METRIC = EvidenceSection(
    name="metric",
    title="How alike the motions are, as far as they can be predicted",
    words=metric_words,
    figure=metric_figure,
    alternative="Differences of the quantiles of simulated and measured angles of both rods, before and after.",
    caption="By how much the quantiles of the simulated angles differ from those of the measured ones, within the"
    " horizon, for"
    " the recording that the bare model misses most. The shaded areas are the metric.",
    tables=(
        FoldedTable(
            "Every recording",
            (
                "run",
                "compared until (s)",
                "growth of errors (1/s)",
                "before (mrad)",
                "after (mrad)",
                "noise alone (mrad)",
            ),
            metric_rows,
            "Compared until: the instant at which the start state's uncertainty alone moves an angle by 0.1 rad; ≥"
            " where that"
            " lies beyond the free run of 2.6 s. Growth: largest finite-time Lyapunov exponent of the angles by then."
            " Areas:"
            " mean of both joints.",
        ),
    ),
    symbols="d = ∫ |F_S(x) − F_D(x)| dx = ∫ |x_S(p) − x_D(p)| dp, F_S and F_D the empirical distributions. Area"
    " validation metric: Ferson, Oberkampf &"
    " Ginzburg (2008), Comput. Methods Appl. Mech. Engrg. 197, 2408-2430.",
)
