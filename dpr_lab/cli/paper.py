"""`dpr-lab paper`: reproduction of the published experiment."""

import os
from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import Json
from dpr_lab.cli.console import emit, line, table

QUICK = {"seeds": 2, "generations": 60}


def paper(
    out: Annotated[Path, typer.Option(help="Folder for paper.md, paper.json, tables and figures.")] = Path("out/paper"),
    seeds: Annotated[
        int,
        typer.Option(
            min=1,
            help="Number of searches for each interpretation of H and each set of true values"
            " (on the coding grid, off the coding grid).",
        ),
    ] = 5,
    generations: Annotated[
        int, typer.Option(min=1, help="Number of generations. The published search has 1000.")
    ] = 1000,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Use at most 2 seeds and 60 generations. This tests the program, not its accuracy."
        ),
    ] = False,
    workers: Annotated[int, typer.Option(min=0, help="Number of searches run in parallel; 0: one per core.")] = 0,
    as_json: Json = False,
) -> None:
    """Reproduce the published tables, searches and figures.

    The tables contain the printed and the recomputed numbers.

    Example: dpr-lab paper --out out/paper
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.paper import paper as run_again

    if quick:
        seeds, generations = min(seeds, QUICK["seeds"]), min(generations, QUICK["generations"])
    with Listener() as listener:
        reproduction = run_again(out, seeds, generations, workers or os.cpu_count() or 1, listener)
    if as_json:
        emit(reproduction.record | {"page": reproduction.page})
        return
    for shown in reproduction.reproduction.tables:
        table(shown.title, shown.columns, shown.rows)
    for sentence in reproduction.reproduction.verdicts:
        line(sentence)
    line(f"page: {reproduction.page}")
