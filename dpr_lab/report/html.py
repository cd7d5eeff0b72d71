"""The report: one HTML file that carries its figures and fetches nothing."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template

from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.model import Model
from dpr_lab.report import tables
from dpr_lab.report.figures import save_figures
from dpr_lab.report.page import figures_html, list_html, table_html, template, write_page
from dpr_lab.report.plain import escaped

FIGURES = {
    "response": (
        "Line charts of the angles of inner and outer rod over time, measured and simulated, for each run.",
        "Measured and simulated angle, 0 = upright, π = hanging. The free run is dashed up to the predictability "
        "horizon; beyond it the start state's uncertainty alone moves the simulation visibly, and the faint line says "
        "nothing about the model.",
    ),
    "error": (
        "Line charts of measured minus simulated angle over time beside the noise floor, for each run.",
        "Left: measured minus free run, up to the horizon. Right: what segments with free start states leave. "
        "A residual that stays inside the band and shows no pattern is noise; a pattern is something the model misses.",
    ),
    "evolution": (
        "Line charts of cost, fitness and population fitness over the generations of the search.",
        "Evolution of the best individual and of the population, up to where the local solver took over.",
    ),
}
"""What each figure is, for a reader who does not see it (its numbers stand in the tables), and its caption."""


def write_report(
    model: Model, comparisons: Sequence[Comparison], out_dir: Path, figures: Mapping[str, Path] | None = None
) -> Path:
    """Write `report.html`: the result, what it rests on, and how far measurement and simulation agree.

    Args:
        model: the identification
        comparisons: runs simulated with it; may be empty
        out_dir: folder of the report, made when it is not there
        figures: what `save_figures` returned, to embed; drawn into `out_dir` when not given

    Returns:
        path of the report

    Raises:
        DprError: the folder or a file cannot be written.
    """
    drawn = save_figures(model, comparisons, out_dir) if figures is None else figures
    return write_page(_page(model, comparisons, drawn), out_dir / "report.html")


def _page(model: Model, comparisons: Sequence[Comparison], figures: Mapping[str, Path]) -> str:
    drawn = figures_html(figures, FIGURES)
    return Template(template()).substitute(
        title=escaped(f"Double pendulum “{model.rig.name}”: identified model"),
        summary=escaped(tables.summary(model, comparisons)),
        warnings=_warnings([*model.failures, *model.warnings]),
        L1=f"{model.rig.L1:g}",
        g=f"{model.rig.g:g}",
        ratios=_ratios(model) + _scaled(model),
        parameters=table_html(tables.PARAMETER_COLUMNS, tables.parameter_rows(model), tables.parameter_note(model)),
        comparisons=_comparisons(comparisons, drawn),
        search=table_html(tables.SEARCH_COLUMNS, tables.search_rows(model), style="prose"),
        evolution=drawn["evolution"],
        runs=table_html(tables.RUN_COLUMNS, tables.run_rows(model), style="hash"),
        rig=escaped(model.rig.name),
        rig_sha256=escaped(model.rig.sha256 or "not known"),
        version=escaped(model.version),
    )


def _ratios(model: Model) -> str:
    return table_html(tables.RATIO_COLUMNS, tables.ratio_rows(model)) + f"\n<p>{escaped(tables.ratio_note(model))}</p>"


def _scaled(model: Model) -> str:
    rows = tables.base_rows(model)
    if not rows:
        return ""
    return "<p>These runs show the scale of the base parameters too.</p>" + table_html(tables.BASE_COLUMNS, rows)


def _comparisons(comparisons: Sequence[Comparison], drawn: Mapping[str, str]) -> str:
    if not comparisons:
        return "<p>No run was compared.</p>"
    table = table_html(tables.COMPARISON_COLUMNS, tables.comparison_rows(comparisons), tables.COMPARISON_NOTE)
    return "\n".join([table, drawn["response"], drawn["error"]])


def _warnings(sentences: Sequence[str]) -> str:
    return f'<section id="warnings">\n<h2>Warnings</h2>\n{list_html(sentences)}\n</section>' if sentences else ""
