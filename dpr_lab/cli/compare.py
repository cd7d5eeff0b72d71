"""`dpr-lab compare`: measured and simulated curves side by side."""

from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import refuse_file
from dpr_lab.cli.console import emit, json_mode, table


def compare(
    runs: Annotated[list[Path], typer.Argument(help="Run files (.mcap); those the model never saw are held out.")],
    model: Annotated[Path, typer.Option(help="The model that `identify` wrote.")],
    out: Annotated[Path, typer.Option(help="Folder of the figures and the report.")] = Path("report"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Compare recorded and simulated swings: figures, residuals and a one-file HTML report.

    Example: dpr-lab compare runs/*.mcap --model model.json --out report
    """
    json_mode(as_json)
    from dpr_lab.compare import compare_run
    from dpr_lab.model import load_model
    from dpr_lab.report.saving import save_comparison
    from dpr_lab.report.tables import COMPARISON_COLUMNS, comparison_rows
    from dpr_lab.storage.reader import load_run, stored_rig

    refuse_file(out)
    identified = load_model(model)
    comparisons = [compare_run(load_run(path), stored_rig(path), identified) for path in runs]
    saved = save_comparison(identified, comparisons, out)
    if as_json:
        emit(saved)
        return
    table("Measured against simulated", COMPARISON_COLUMNS, comparison_rows(comparisons))
    print(f"report: {saved['report']}")
