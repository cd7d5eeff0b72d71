"""`dpr-lab demo`: complete workflow on a simulated rig, then a blind trial of the diagnosis."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import Json
from dpr_lab.cli.console import emit, line, table
from dpr_lab.shown import in_command

if TYPE_CHECKING:
    from dpr_lab.workflows.demo import DemoResult


def demo(
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the results. Default: out/demo, or sample with --table."),
    ] = None,
    sample: Annotated[
        bool, typer.Option("--table", help="Write sample tables (CSV) and their rig file instead.")
    ] = False,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Seed of the demo; the same seed gives the same demo. By default the plant of the trial is random.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Record, identify, compare and diagnose a simulated double pendulum.

    A second plant is then diagnosed, whose effect is hidden until the end.

    The simulated device is a separate process with its own plant; its true values are requested only at the end. The
    first demo on a computer compiles the kernels, which takes a minute or two.

    With --table, the command only writes sample files for practice: three recorded releases as CSV tables, the points
    tracked in their videos, and the rig file. See docs/tutorials/your-table.md and docs/how-to/video.md.

    Example: dpr-lab demo --out out/demo
    """
    if sample:
        _write_tables(out or Path("sample"), as_json)
        return
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.demo import demo as run_demo

    with Listener() as listener:
        outcome = run_demo(out or Path("out/demo"), seed, listener)
    if as_json:
        emit(_record(outcome))
    else:
        _show(outcome)


def _write_tables(out: Path, as_json: bool) -> None:
    from dpr_lab.workflows.sample_tables import write_sample_tables

    rig, *tables = write_sample_tables(out)
    if as_json:
        emit({"rig": rig, "tables": tables})
        return
    for file in (rig, *tables):
        line(file)
    table = in_command(rig.with_name("side.csv"))
    line(f"next: dpr-lab import table {table} --rig {in_command(rig)} --dry-run")


def _record(done: "DemoResult") -> dict[str, Any]:
    from dpr_lab.cli.trials import opening

    known, hidden = done.known, done.hidden
    return {
        "runs": known.runs,
        "model": known.model_file,
        "report": known.report,
        "ratios": {name: estimate.model_dump() for name, estimate in known.model.ratios.items()},
        "plant": known.ratios,
        "deviations_std": {name: row[-1] for name, row in known.comparison.items()},
        "trial": opening(hidden.opened) | {"folder": hidden.trial.folder, "report": hidden.report},
    }


def _show(done: "DemoResult") -> None:
    from dpr_lab.cli.identify import show as show_model
    from dpr_lab.cli.trials import show_opened
    from dpr_lab.report.words import in_words

    known, hidden = done.known, done.hidden
    show_model(known.model)
    table(
        "Five ratios: identified and true values",
        ("ratio", "identified", "std", "plant", "deviation, std"),
        [(name, f"{v:.7g}", f"{s:.2g}", f"{p:.7g}", f"{z:+.2f}") for name, (v, s, p, z) in known.comparison.items()],
    )
    line(f"report: {known.report}")
    line()
    line("Blind trial: a plant with a hidden effect")
    line(f"bare model: chi-square per degree of freedom {hidden.model.fit.chi2_per_dof:.3g} (1 = noise only)")
    line(f"diagnosis: {in_words(hidden.diagnosis.sentence)}")
    show_opened(hidden.opened, hidden.trial)
    line(f"report: {hidden.report}")
