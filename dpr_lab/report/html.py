"""The report: one HTML file that carries its figures and fetches nothing."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from dpr_lab.compare import Comparison
from dpr_lab.model import Model
from dpr_lab.report import tables
from dpr_lab.report.figures import save_figures, write_to

ALTERNATIVES = {
    "response": "Line charts of the angles of inner and outer rod over time, measured and simulated, for each run.",
    "error": "Line charts of measured minus simulated angle over time beside the noise floor, for each run.",
    "evolution": "Line charts of cost, fitness and population fitness over the generations of the search.",
}
"""What each figure is, for a reader who does not see it; its numbers stand in the tables."""

CAPTIONS = {
    "response": "Measured and simulated angle, 0 = upright, π = hanging. The free run is dashed up to the "
    "predictability horizon; beyond it the start state's uncertainty alone moves the simulation visibly, and the "
    "faint line says nothing about the model.",
    "error": "Left: measured minus free run, up to the horizon. Right: what segments with free start states leave. "
    "A residual that stays inside the band and shows no pattern is noise; a pattern is something the model misses.",
    "evolution": "Evolution of the best individual and of the population, up to where the local solver took over.",
}


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
    path = out_dir / "report.html"
    page = _page(model, comparisons, drawn)
    # A file name may hold bytes that are no text; the page stays valid UTF-8.
    write_to(path, lambda file: file.write_bytes(page.encode("utf-8", "replace")))
    return path


def _page(model: Model, comparisons: Sequence[Comparison], figures: Mapping[str, Path]) -> str:
    template = Template(files("dpr_lab.report").joinpath("template.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=escape(f"Double pendulum “{model.rig.name}”: identified model"),
        summary=escape(tables.summary(model, comparisons)),
        warnings=_warnings([*model.failures, *model.warnings]),
        L1=f"{model.rig.L1:g}",
        g=f"{model.rig.g:g}",
        ratios=table_html(tables.RATIO_COLUMNS, tables.ratio_rows(model)),
        parameters=table_html(tables.PARAMETER_COLUMNS, tables.parameter_rows(model)),
        comparisons=_comparisons(comparisons, figures),
        search=table_html(tables.SEARCH_COLUMNS, tables.search_rows(model), style="prose"),
        evolution=_figure("evolution", figures),
        runs=table_html(tables.RUN_COLUMNS, tables.run_rows(model), style="hash"),
        rig=escape(model.rig.name),
        rig_sha256=escape(model.rig.sha256 or "not known"),
        version=escape(model.version),
    )


def _comparisons(comparisons: Sequence[Comparison], figures: Mapping[str, Path]) -> str:
    if not comparisons:
        return "<p>No run was compared.</p>"
    caption = (
        "Numbers in pairs are θ1, θ2. rms: residual of segments with free start states. "
        "Free run: residual of one simulation from the release to the horizon. "
        "Held out: the run took no part in the fit. ≥: predictable to the end of the record."
    )
    table = table_html(tables.COMPARISON_COLUMNS, tables.comparison_rows(comparisons), caption)
    return "\n".join([table, _figure("response", figures), _figure("error", figures)])


def table_html(columns: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "", style: str = "") -> str:
    """A table of text."""
    head = "".join(f'<th scope="col">{escape(column)}</th>' for column in columns)
    body = "\n".join(f"<tr>{_row(row)}</tr>" for row in rows)
    title = f"<caption>{escape(caption)}</caption>\n" if caption else ""
    named = f' class="{style}"' if style else ""
    return (
        f'<div class="scroll" tabindex="0"><table{named}>\n{title}<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def _row(cells: Sequence[str]) -> str:
    first, *rest = (escape(cell) for cell in cells)
    return f'<th scope="row">{first}</th>' + "".join(f"<td>{cell}</td>" for cell in rest)


def _figure(name: str, figures: Mapping[str, Path]) -> str:
    return figure_html(name, figures[name], ALTERNATIVES[name], CAPTIONS[name])


def figure_html(name: str, path: Path, alternative: str, caption: str) -> str:
    """A figure that carries its picture, with a text for readers who do not see it."""
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return (
        f'<figure id="{name}">\n<img alt="{escape(alternative)}" src="data:image/png;base64,{data}">\n'
        f"<figcaption>{escape(caption)}</figcaption>\n</figure>"
    )


def _warnings(sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    items = "\n".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f'<section id="warnings">\n<h2>Warnings</h2>\n<ul>\n{items}\n</ul>\n</section>'
