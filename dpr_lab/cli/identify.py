"""`dpr-lab identify`: identification of a model from runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.checks import OBJECTIVE_NAMES, SEARCHES, AnyClock, Json, RigName, Seed, TorqueKind
from dpr_lab.cli.console import emit, line, report_table, say, table
from dpr_lab.errors import IdentificationError

if TYPE_CHECKING:
    from dpr_lab.identification.model import Model
    from dpr_lab.identification.moving_arm.model import MovingArmModel


def identify(
    runs: Annotated[list[Path], typer.Argument(help="Run files (.mcap), preferably of two or more poses.")],
    rig: RigName,
    objective: Annotated[
        str,
        typer.Option(
            help="Objective of the search: short segments, insensitive to chaos [segments],"
            " or published E(Z) of whole runs [paper].",
            callback=OBJECTIVE_NAMES.check,
            autocompletion=OBJECTIVE_NAMES.complete,
        ),
    ] = "segments",
    search: Annotated[
        str,
        typer.Option(
            help=(
                "Search algorithm: improved genetic algorithm [iga], plain genetic algorithm [plain_ga] or covariance"
                " matrix adaptation [cma_es]."
            ),
            callback=SEARCHES.check,
            autocompletion=SEARCHES.complete,
        ),
    ] = "iga",
    settings: Annotated[
        str | None, typer.Option(help="Search settings: a TOML file, or the name of a built-in one.")
    ] = None,
    seed: Seed = 0,
    profile: Annotated[
        bool, typer.Option("--profile", help="Also compute profile likelihood intervals of the ratios.")
    ] = False,
    out: Annotated[Path, typer.Option(help="File for the model.")] = Path("model.json"),
    any_clock: AnyClock = False,
    torque: TorqueKind = None,
    as_json: Json = False,
) -> None:
    """Identify the parameters of a rig from recorded swings.

    Example: dpr-lab identify runs/*.mcap --rig paper --out model.json
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.identification.moving_arm.model import MovingArmModel
    from dpr_lab.workflows.identify import IdentifyRequest
    from dpr_lab.workflows.identify import identify as identify_runs

    request = IdentifyRequest(tuple(runs), rig, out, objective, search, settings, seed, profile, any_clock, torque)
    with Listener() as listener:
        identified = identify_runs(request, listener)
    model = identified.model
    if as_json:
        emit(identified.to_json())
    else:
        if isinstance(model, MovingArmModel):
            show_moving_arm(model)
        else:
            show(model)
        line(f"model: {out}")
    if model.failures:
        raise IdentificationError(
            f"{'; '.join(model.failures).rstrip('.')}. The model was written to {out}, but it is not reliable"
        )


def show_moving_arm(model: "MovingArmModel") -> None:
    """Print the model of a rig with a moving arm as tables on stdout."""
    from dpr_lab.report import moving_arm, tables
    from dpr_lab.report.digits import superscripts

    line(moving_arm.summary(model))
    reference = "the inertia a of the inner rod" if model.scale == "a" else "the inertia b of the outer rod"
    report_table(f"Ratios to {reference}", tables.ratio_table(model))
    note = f"{superscripts(model.scale_sentence)} A is the total inertia about the arm's axis."
    report_table("Absolute values", moving_arm.absolute_table(model), note)
    for name, sentence in model.undetermined.items():
        say(f"{name}: {sentence}")
    for note in model.notes:
        say(superscripts(note))
    for warning in model.warnings:
        say(f"warning: {warning}")


def show(model: "Model") -> None:
    """Print the model as tables on stdout."""
    from dpr_lab.report import tables

    line(tables.summary(model))
    report_table(tables.ratio_title(model), tables.ratio_table(model), tables.ratio_note(model))
    if absolute := tables.base_table(model):
        report_table(tables.BASE_TITLE, absolute)
    profiled = [(name, e.profile90) for name, e in model.ratios.items() if e.profile90 is not None]
    if profiled:
        rows = [(name, *("none" if end is None else f"{end:.7g}" for end in ends)) for name, ends in profiled]
        table("90 % intervals by profile likelihood", ("ratio", "from", "to"), rows)
    nine = tables.parameter_table(model)
    count = "Parameters" if model.fitted else "Nine parameters"
    report_table(f"{count} and what determines them", nine, tables.parameter_note(model))
    for warning in model.warnings:
        say(f"warning: {warning}")
