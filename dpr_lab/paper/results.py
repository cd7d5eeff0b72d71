"""Reproduction of the published experiment and its files: `paper.json`, tables as CSV, figures, and `paper.md`."""

import csv
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dpr_lab.paper.campaign import TRUTHS, SearchCase, SearchResult, run_searches, search_cases
from dpr_lab.paper.figures import save_figures
from dpr_lab.paper.printed import BEST_H, CONTRADICTIONS, FIGURES, PERCENT_ERRORS
from dpr_lab.paper.swings import READINGS
from dpr_lab.paper.tables import PaperTable, Recomputed, all_tables, recompute, verdicts
from dpr_lab.rig import Rig
from dpr_lab.search.settings import IgaSettings
from dpr_lab.version import __version__
from dpr_lab.whole_file import write_text


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Results of the reproduction."""

    settings: IgaSettings
    results: tuple[SearchResult, ...]
    """Results of the searches, in the order of `campaign.search_cases`."""
    ours: Recomputed
    tables: tuple[PaperTable, ...]
    verdicts: tuple[str, ...]

    @property
    def best(self) -> SearchResult:
        """Search with the smallest angle error E from X1; the figures show it.

        Only searches with the true values on the coding grid are considered. H is not compared, because its
        interpretation differs between the searches.
        """
        return min((f for f in self.results if f.case.grid == "on"), key=lambda f: f.E["angles"][0])


def reproduce(
    rig: Rig,
    settings: IgaSettings,
    *,
    seeds: int = 5,
    readings: Sequence[str] = tuple(READINGS),
    workers: int = 1,
    on_search: Callable[[SearchResult], None] | None = None,
) -> Reproduction:
    """Run the published experiment.

    Args:
        rig: the published rig
        settings: the published settings, possibly with fewer generations
        seeds: number of searches for each interpretation of H and each grid
        readings: names in `READINGS`
        workers: number of searches in parallel
        on_search: function that is called with each result as soon as its search has ended

    Raises:
        ValueError: `seeds` is zero, or an interpretation is unknown.
    """
    if seeds < 1 or not readings or not set(readings) <= set(READINGS):
        raise ValueError(f"needs at least one seed and readings among {', '.join(READINGS)}")
    cases = search_cases(seeds, readings)
    finished: dict[SearchCase, SearchResult] = {}
    for search in run_searches(cases, rig, settings, min(workers, len(cases))):
        finished[search.case] = search
        if on_search:
            on_search(search)
    results = [finished[case] for case in cases]
    recomputed = recompute(rig)
    return Reproduction(
        settings=settings,
        results=tuple(results),
        ours=recomputed,
        tables=tuple(all_tables(recomputed, results, rig)),
        verdicts=tuple(verdicts(results, rig)),
    )


def record(result: Reproduction, rig: Rig) -> dict[str, Any]:
    """Return the content of `paper.json`."""
    return {
        "version": __version__,
        "settings": result.settings.model_dump(),
        "printed": {"best_H": BEST_H, "percent_errors": PERCENT_ERRORS.tolist()},
        "truths": {grid: Z.tolist() for grid, Z in TRUTHS.items()},
        "readings": {name: reading.why for name, reading in READINGS.items()},
        "table1_E": {term: E.tolist() for term, E in result.ours.table1.items()},
        "table3_E": {term: E.tolist() for term, E in result.ours.table3.items()},
        "searches": [search.record(rig) for search in result.results],
        "verdicts": list(result.verdicts),
        "contradictions": [{"claim": claim, "evidence": "docs/theory.md, section 2"} for claim in CONTRADICTIONS],
    }


def save(result: Reproduction, rig: Rig, out_dir: Path) -> Path:
    """Write `paper.json`, one CSV per table, the figures, and `paper.md`.

    Returns:
        path of `paper.md`

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = save_figures(result.best, rig, out_dir)
    texts = {"paper.json": json.dumps(record(result, rig), indent=1) + "\n"}
    texts |= {f"{table.name}.csv": _csv(table) for table in result.tables}
    texts["paper.md"] = _page(result, figures)
    for name, text in texts.items():
        write_text(out_dir / name, text)
    return out_dir / "paper.md"


def _csv(table: PaperTable) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([table.columns, *table.rows])
    return text.getvalue()


def _markdown(table: PaperTable) -> str:
    lines = [table.columns, ["---"] * len(table.columns), *table.rows]
    return f"## {table.title}\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _page(result: Reproduction, figures: dict[str, Path]) -> str:
    shown = result.best
    s = result.settings
    head = (
        "# Reproduction of the published experiment\n\n"
        f"M = {s.population}, {s.generations} generations, Pc = {s.crossover_rate}, Pm = {s.mutation_rate}, "
        f"alpha = {s.alpha}, sigma = {s.sigma}, delta = {s.delta}, mu = {s.mu}, nu = {s.nu}; 10 s, 5 ms, "
        f"classical Runge-Kutta. M of the fitness ({s.fitness_scale:g}) and the interpretation of H are our"
        " choices: the paper gives neither.\n\n" + "\n".join(f"- {sentence}" for sentence in result.verdicts) + "\n"
    )
    pictures = (
        f"## Figures\n\nH = {shown.case.reading}, true values {shown.case.grid} the grid, seed {shown.case.seed}: "
        f"best H {shown.H:.4g}.\n\n"
        + "\n".join(f"{FIGURES[name]}\n\n![{name}]({path.name})\n" for name, path in figures.items())
    )
    return "\n".join([head, *(_markdown(table) for table in result.tables), pictures])
