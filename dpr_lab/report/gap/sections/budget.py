"""How far a prediction may be off without any fault of the model, and how far it is off."""

import numpy as np
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report import style
from dpr_lab.report.digits import NONE, three
from dpr_lab.report.figures import legend_above, new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, FoldedTable, evidence_of
from dpr_lab.report.gap.tables import run_words


def budget_figure(diagnosis: Diagnosis) -> Figure:
    """Bars of all contributions, of their sum, and of the error, before and after."""
    budget = evidence_of(diagnosis).budget
    bars = [(item.name, item.before_rad, item.after_rad) for item in budget.sources]
    bars += [
        ("all together, u_val", budget.u_before_rad, budget.u_after_rad),
        ("error, E", budget.error_before_rad, budget.error_after_rad),
    ]
    with style.house_style():
        names, before, after = zip(*bars, strict=True)
        figure = new_figure(1.1 + 0.42 * len(names))
        axes = figure.subplots()
        rows = np.arange(len(names))
        told = 1e3 * np.array([*before, *after])
        least = 10.0 ** np.floor(np.log10(max(float(np.min(told[told > 0], initial=1.0)), PAGE.least_mrad)))
        for offset, values, label, look in (
            (-0.19, before, "before", style.SIMULATED),
            (0.19, after, "after", style.RESIDUAL),
        ):
            heights = np.maximum(1e3 * np.array(values), least)
            drawn = axes.barh(rows + offset, heights, height=0.36, color=look["color"], label=f"{label} the effects")
            axes.bar_label(drawn, [three(1e3 * value) for value in values], padding=3, fontsize=8)
        axes.set_xscale("log")
        axes.set_xlim(least, 8 * max(float(told.max()), 10 * least))
        axes.set_yticks(rows, names)
        axes.axhline(len(budget.sources) - 0.5, color="#555555", linewidth=0.8)
        axes.invert_yaxis()
        axes.set_xlabel("moves a predicted angle by, rms (mrad)")
        legend_above(figure)
        return figure


def budget_words(diagnosis: Diagnosis) -> list[str]:
    """Error against uncertainty, in words."""
    budget = evidence_of(diagnosis).budget
    return [
        "A simulation can miss a recording although its model is right: the start is known only as well as the encoders"
        " read, lengths and gravity only as well as they were measured, and the integrator rounds. Below stands by"
        " how much"
        " each of these moves a free run, and how far the free run is off. Only an error beyond twice the sum is the"
        " model's own fault.",
        f"Before: {_judged(budget.error_before_rad, budget.u_before_rad)}"
        f" After: {_judged(budget.error_after_rad, budget.u_after_rad)}",
    ]


def _judged(error: float, uncertainty: float) -> str:
    told = (
        f"the free run is off by {three(1e3 * error)} mrad; without any fault of the model it may be off by"
        f" {three(1e3 * uncertainty)} mrad (one standard uncertainty), so"
    )
    if error <= PAGE.coverage_factor * uncertainty:
        return f"{told} no fault is seen."
    own = (error**2 - uncertainty**2) ** 0.5
    return f"{told} the model itself is off by about {three(1e3 * own)} mrad."


def source_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Every contribution, their sum and the error."""
    budget = evidence_of(diagnosis).budget
    rows = [
        (item.name, item.kind, item.how, f"{item.left:.1%}", three(1e3 * item.before_rad), three(1e3 * item.after_rad))
        for item in budget.sources
    ]
    for name, before, after in (
        ("u_val", budget.u_before_rad, budget.u_after_rad),
        ("E", budget.error_before_rad, budget.error_after_rad),
    ):
        rows.append((name, NONE, NONE, NONE, three(1e3 * before), three(1e3 * after)))
    return rows


def run_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Error and uncertainty of every free run."""
    return [
        (
            run_words(run.run, run.held_out),
            *(three(1e3 * value) for value in (run.error_before_rad, run.u_before_rad)),
            *(three(1e3 * value) for value in (run.error_after_rad, run.u_after_rad)),
            three(run.error_after_rad / run.u_after_rad) if run.u_after_rad > 0 else NONE,
        )
        for run in evidence_of(diagnosis).budget.runs
    ]


BUDGET = EvidenceSection(
    name="budget",
    title="How far a prediction may be off",
    words=budget_words,
    figure=budget_figure,
    alternative="Bars of what each source of uncertainty moves a prediction by, before and after, beside the error.",
    caption="By how much each source moves a free run whose start state 0.3 s of readings fix, rms over all"
    " recordings up"
    " to 2.6 s or the predictability horizon, both joints. Logarithmic.",
    tables=(
        FoldedTable(
            "The budget in numbers",
            ("source", "kind", "how it is known", "left by the recordings", "before (mrad)", "after (mrad)"),
            source_rows,
            "Left by the recordings: what was put in would show in them where it is large, and counts only as far as it"
            " does not (corrected model).",
        ),
        FoldedTable(
            "Every free run",
            (
                "run",
                "E before (mrad)",
                "u_val before (mrad)",
                "E after (mrad)",
                "u_val after (mrad)",
                "E / u_val after",
            ),
            run_rows,
        ),
    ),
    symbols="E = S − D, u_val² = u_num² + u_input² + u_D². E beyond 2 u_val: δ_model = E ± u_val. ASME V&V 20-2009;"
    " limits"
    " without a distribution as JCGM 100:2008 (GUM), 4.3.7. The model was calibrated on the fitted recordings, and"
    " their E"
    " is no blind test; that of held-out ones is.",
)
