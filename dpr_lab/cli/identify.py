"""`dpr-lab identify`: runs in, model.json out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.console import emit, json_mode, progress, say, table
from dpr_lab.errors import IdentificationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dpr_lab.model import Model
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run
    from dpr_lab.search.problem import Generation


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
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same answer.")] = 0,
    profile: Annotated[bool, typer.Option("--profile", help="Add profile likelihood intervals of the ratios.")] = False,
    out: Annotated[Path, typer.Option(help="Where the model is written.")] = Path("model.json"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Identify the kinetic parameters from recorded free swings.

    Example: dpr-lab identify runs/*.mcap --rig paper --out model.json
    """
    json_mode(as_json)
    from dpr_lab.rig import load_rig
    from dpr_lab.run import refuse_repeated
    from dpr_lab.search import load_search
    from dpr_lab.storage.reader import load_run

    described = load_rig(rig)
    loaded = [load_run(path, rig=described) for path in runs]
    refuse_repeated(loaded)
    for run in loaded:
        for note in run.notes:
            say(f"{run.name}: {note}")
    chosen = load_search(settings) if settings else None
    model = search_with_progress(
        loaded,
        described,
        objective=objective,
        search=chosen.algorithm if chosen else search,
        settings=chosen,
        seed=seed,
        profile=profile,
    )
    model.save(out)
    if as_json:
        emit(model.model_dump() | {"model": str(out)})
    else:
        show(model)
        print(f"model: {out}")
    if model.failures:
        raise IdentificationError("; ".join(model.failures) + f" (the model is kept in {out}, not to be trusted)")


def search_with_progress(runs: "Sequence[Run]", rig: "Rig", **chosen: Any) -> "Model":
    """`dpr_lab.identify.identify` with a progress bar on a terminal."""
    from dpr_lab.identify import identify as identify_runs

    with progress("identify", 1.0) as bar:

        def on_generation(generation: "Generation", at_most: int) -> None:
            bar(generation.number / at_most, f"generation {generation.number}, cost {generation.best_cost:.4g}")

        return identify_runs(runs, rig, on_generation=on_generation, **chosen)


def show(model: "Model") -> None:
    """The model as tables on stdout."""
    from dpr_lab.report.tables import PARAMETER_COLUMNS, RATIO_COLUMNS, parameter_rows, ratio_rows, summary

    print(summary(model))
    table("Five ratios: all that a free swing fixes", RATIO_COLUMNS, ratio_rows(model))
    profiled = [(name, e.profile90) for name, e in model.ratios.items() if e.profile90 is not None]
    if profiled:
        rows = [(name, *("none" if end is None else f"{end:.7g}" for end in ends)) for name, ends in profiled]
        table("90 % intervals by profile likelihood", ("ratio", "from", "to"), rows)
    table("Nine parameters, and what fixed each", PARAMETER_COLUMNS, parameter_rows(model))
    for warning in model.warnings:
        say(f"warning: {warning}")
