"""Show the uncertainty of the prediction by source, and the error of the prediction."""

import numpy as np
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import FREE_RUN_TEST
from dpr_lab.report import style
from dpr_lab.report.digits import NONE, three
from dpr_lab.report.figures import legend_above, new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, evidence_of
from dpr_lab.report.gap.tables import run_words
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.shown import percent


def budget_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the contributions, the combined uncertainty and the error, for the bare and the corrected model."""
    budget = evidence_of(diagnosis).budget
    bars = [(source.name, source.before_rad, source.after_rad) for source in budget.sources]
    bars += [
        ("combined uncertainty u_val", budget.u_before_rad, budget.u_after_rad),
        ("error E", budget.error_before_rad, budget.error_after_rad),
    ]
    names, before, after = zip(*bars, strict=True)
    figure = new_figure(1.1 + 0.42 * len(names))
    axes = figure.subplots()
    rows = np.arange(len(names))
    heights = 1e3 * np.array([*before, *after])
    least = 10.0 ** np.floor(np.log10(max(float(np.min(heights[heights > 0], initial=1.0)), PAGE.least_mrad)))
    for offset, values, (label, line) in zip((-0.19, 0.19), (before, after), style.MODELS.values(), strict=True):
        lengths = np.maximum(1e3 * np.array(values), least)
        patches = axes.barh(rows + offset, lengths, height=0.36, color=line["color"], label=label)
        axes.bar_label(patches, [three(1e3 * value) for value in values], padding=3, fontsize=8)
    axes.set_xscale("log")
    axes.set_xlim(least, 8 * max(float(heights.max()), 10 * least))
    axes.set_yticks(rows, names)
    axes.axhline(len(budget.sources) - 0.5, **style.ZERO)
    axes.invert_yaxis()
    axes.set_xlabel("contribution to the predicted angle, rms (mrad)")
    legend_above(figure)
    return figure


def budget_words(diagnosis: Diagnosis) -> list[str]:
    """Compose sentences that compare the error with the uncertainty of the inputs."""
    budget = evidence_of(diagnosis).budget
    return [
        "A simulation can differ from a recording even if the model is correct, because initial state, lengths and"
        " gravity are uncertain and the integrator has errors. The figure shows how much each of these changes a free"
        f" run, and the error of the free run. If the error exceeds {FREE_RUN_TEST.coverage:g} times the combined"
        " uncertainty, the model has an error.",
        f"Bare model: {_judged(budget.error_before_rad, budget.u_before_rad)}"
        f" Corrected model: {_judged(budget.error_after_rad, budget.u_after_rad)}",
    ]


def _judged(error: float, uncertainty: float) -> str:
    numbers = (
        f"error of the free run {three(1e3 * error)} mrad, standard uncertainty of the inputs"
        f" {three(1e3 * uncertainty)} mrad;"
    )
    if error <= FREE_RUN_TEST.coverage * uncertainty:
        return f"{numbers} no model error is detected."
    model_error = (error**2 - uncertainty**2) ** 0.5
    return f"{numbers} the model error is about {three(1e3 * model_error)} mrad."


@page_table(
    "source",
    "kind",
    "origin",
    "share not excluded by the recordings",
    "bare model (mrad rms)",
    "corrected model (mrad rms)",
    caption="Share not excluded by the recordings: a larger error of an input would be visible in the residual of the"
    " corrected model. Only this share of its standard uncertainty contributes.",
    style="prose",
    title="Values of the uncertainty budget",
)
def source_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each contribution, then the combined uncertainty and the error."""
    budget = evidence_of(diagnosis).budget
    rows = [
        (
            source.name,
            source.kind,
            source.how,
            percent(source.left, 1),
            three(1e3 * source.before_rad),
            three(1e3 * source.after_rad),
        )
        for source in budget.sources
    ]
    for name, before, after in (
        ("combined uncertainty u_val", budget.u_before_rad, budget.u_after_rad),
        ("error E", budget.error_before_rad, budget.error_after_rad),
    ):
        rows.append((name, NONE, NONE, NONE, three(1e3 * before), three(1e3 * after)))
    return rows


@page_table(
    "run",
    "E, bare model (mrad)",
    "u_val, bare model (mrad)",
    "E, corrected model (mrad)",
    "u_val, corrected model (mrad)",
    "E / u_val, corrected model",
    style="prose",
    title="Error and uncertainty by run",
)
def run_gap_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each free run, with its error and its uncertainty."""
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
    title="Prediction uncertainty",
    words=budget_words,
    figure=budget_figure,
    alternative="Bars of the contribution of each source of uncertainty, and of the error, for both models.",
    caption=(
        "Contribution of each source to the uncertainty of a free run: rms over all joints and"
        " recordings, up to 2.6 s or the predictability horizon. The initial state of the free run is"
        " fitted to 0.3 s of readings. Logarithmic scale."
    ),
    tables=(
        source_table,
        run_gap_table,
    ),
    symbols="E = S − D (simulation minus data); u_val² = u_num² + u_input² + u_D² (integrator, inputs, readings); model"
    " error δ = E ± u_val. Source: ASME V&V 20-2009; for limits without a distribution, JCGM 100:2008 (GUM), 4.3.7."
    " Only E of held-out recordings is a blind test, because the model was calibrated on the fitted recordings.",
)
