"""`dpr-lab identify`: runs in, model.json out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.console import emit, json_mode, progress, say, table
from dpr_lab.errors import IdentificationError

if TYPE_CHECKING:
    from dpr_lab.model import Model


def identify(
    runs: Annotated[list[Path], typer.Argument(help="Run files (.mcap); two of the three poses are enough.")],
    rig: Annotated[str, typer.Option(help="Rig file, or the name of a built-in one.")],
    objective: Annotated[
        str, typer.Option(help="segments: chaos-safe. paper: E(Z) over the whole runs, equation (2).")
    ] = "segments",
    search: Annotated[str, typer.Option(help="Search algorithm.")] = "iga",
    settings: Annotated[
        str | None, typer.Option(help="Search settings: a TOML file, or the name of a built-in one.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Same seed, same answer.")] = 0,
    out: Annotated[Path, typer.Option(help="Where the model is written.")] = Path("model.json"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Identify the kinetic parameters from recorded free swings.

    Example: dpr-lab identify runs/*.mcap --rig paper --out model.json
    """
    json_mode(as_json)
    from dpr_lab.rig import load_rig
    from dpr_lab.search import ALGORITHMS
    from dpr_lab.storage.reader import load_run

    described = load_rig(rig)
    loaded = [load_run(path, rig=described) for path in runs]
    for run in loaded:
        for note in run.notes:
            say(f"{run.name}: {note}")
    chosen = ALGORITHMS[search].settings(settings) if settings and search in ALGORITHMS else None
    model = search_with_progress(loaded, described, objective, search, chosen, seed)
    model.save(out)
    if as_json:
        emit(model.model_dump() | {"model": str(out)})
    else:
        show(model)
        print(f"model: {out}")
    if model.failures:
        raise IdentificationError("; ".join(model.failures) + f" (the model is kept in {out}, not to be trusted)")


def search_with_progress(loaded, rig, objective, search, settings, seed) -> "Model":
    """Identify with a progress bar on a terminal."""
    from dpr_lab.identify import identify as run_identification

    with progress("identify", 1.0) as bar:

        def on_generation(generation, at_most: int) -> None:
            bar(generation.number / at_most, f"generation {generation.number}, cost {generation.best_cost:.4g}")

        return run_identification(
            loaded,
            rig,
            objective=objective,
            search=search,
            settings=settings,
            seed=seed,
            on_generation=on_generation,
        )


def show(model: "Model") -> None:
    """The model as tables on stdout."""
    from dpr_lab.report.tables import PARAMETER_COLUMNS, RATIO_COLUMNS, parameter_rows, ratio_rows, summary

    print(summary(model))
    table("Five ratios: all that a free swing fixes", RATIO_COLUMNS, ratio_rows(model))
    table("Nine parameters, and what fixed each", PARAMETER_COLUMNS, parameter_rows(model))
    for warning in model.warnings:
        say(f"warning: {warning}")
