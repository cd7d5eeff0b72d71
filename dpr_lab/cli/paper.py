"""`dpr-lab paper`: the published experiment again, beside what it prints."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.console import emit, json_mode, progress, table

if TYPE_CHECKING:
    from dpr_lab.paper.campaign import Found

QUICK = {"seeds": 2, "generations": 60}


def paper(
    out: Annotated[Path, typer.Option(help="Folder of paper.md, paper.json, tables and figures.")] = Path("out/paper"),
    seeds: Annotated[int, typer.Option(min=1, help="Searches for each reading of H, on and off the grid.")] = 5,
    generations: Annotated[int, typer.Option(min=1, help="The paper has 1000.")] = 1000,
    quick: Annotated[
        bool, typer.Option("--quick", help="At most 2 seeds and 60 generations: whether it runs, not how well.")
    ] = False,
    workers: Annotated[int, typer.Option(min=0, help="Searches side by side; 0: one on each core.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Repeat the paper's tables, searches and figures, and say what does not reproduce.

    Example: dpr-lab paper --out out/paper
    """
    json_mode(as_json)
    import os

    from dpr_lab.paper.campaign import jobs
    from dpr_lab.paper.results import record, reproduce, save
    from dpr_lab.paper.swings import READINGS
    from dpr_lab.rig import load_rig
    from dpr_lab.search import load_search
    from dpr_lab.search.settings import IgaSettings

    if quick:
        seeds, generations = min(seeds, QUICK["seeds"]), min(generations, QUICK["generations"])
    rig, settings = load_rig("paper"), load_search("paper")
    assert isinstance(settings, IgaSettings)
    settings = settings.model_copy(update={"generations": generations})
    total, done = len(jobs(seeds, tuple(READINGS))), 0
    with progress("paper", total) as bar:

        def on_search(found: "Found") -> None:
            nonlocal done
            done += 1
            bar(done, f"search {done} of {total}")

        result = reproduce(rig, settings, seeds=seeds, workers=workers or os.cpu_count() or 1, on_search=on_search)
    page = save(result, rig, out)
    if as_json:
        emit(record(result, rig) | {"page": str(page)})
        return
    for made in result.tables:
        table(made.title, made.columns, made.rows)
    for sentence in result.verdicts:
        print(sentence)
    print(f"page: {page}")
