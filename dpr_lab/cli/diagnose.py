"""`dpr-lab diagnose`: why simulation and rig differ."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import refuse_file
from dpr_lab.cli.console import emit, json_mode, progress, say, table
from dpr_lab.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from dpr_lab.effects.effect import Effect
    from dpr_lab.gap.diagnosis import Diagnosis
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


def complete_effect(incomplete: str) -> list[str]:
    """Effects that an option's last name, after any comma, can become."""
    from dpr_lab.effects import EFFECTS

    before, comma, begun = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in EFFECTS if name.startswith(begun)]


def diagnose(
    runs: Annotated[list[Path], typer.Argument(help="Run files (.mcap); three releases or more tell effects apart.")],
    rig: Annotated[str, typer.Option(help="Rig file, or the name of a built-in one.")],
    model: Annotated[Path | None, typer.Option(help="A model that `identify` wrote, to start from.")] = None,
    held_out: Annotated[
        list[Path] | None, typer.Option(help="Run that only measures how far the gap closes; may be given again.")
    ] = None,
    library: Annotated[
        str | None,
        typer.Option(help="Effects to choose from, by comma; all by default.", autocompletion=complete_effect),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(help="Effect to leave out; may be given again.", autocompletion=complete_effect),
    ] = None,
    max_effects: Annotated[int, typer.Option(min=1, max=8, help="At most so many effects at once.")] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same answer.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder of report, figures, corrected model and exports.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Say where simulation and rig differ, which effect causes it, how sure that is and how much of it closes.

    Example: dpr-lab diagnose runs/*.mcap --rig paper --out out/diagnosis
    """
    json_mode(as_json)
    from dpr_lab.model import load_model
    from dpr_lab.report.saving import save_diagnosis
    from dpr_lab.rig import load_rig
    from dpr_lab.run import refuse_repeated
    from dpr_lab.storage.reader import load_run

    described = load_rig(rig)
    loaded = [load_run(path, rig=described) for path in runs]
    unseen = [load_run(path, rig=described) for path in held_out or []]
    refuse_repeated([*loaded, *unseen])
    if out:
        refuse_file(out)
    found = diagnose_with_progress(
        loaded,
        described,
        held_out=unseen,
        library=chosen_library(library, without or []),
        max_effects=max_effects,
        start=load_model(model).starting_point(described) if model else None,
        seed=seed,
    )
    written = save_diagnosis(found, loaded, described, out) if out else {}
    if as_json:
        emit(found.to_json() | ({"files": written} if written else {}))
        return
    show(found)
    for name, path in written.items():
        say(f"{name}: {path}")


def chosen_library(names: str | None, without: "Sequence[str]") -> "Mapping[str, Effect]":
    """The effects to choose from.

    Raises:
        ConfigError: a name that is no effect, or none left.
    """
    from dpr_lab.effects import EFFECTS

    wanted = list(EFFECTS) if names is None else [name.strip() for name in names.split(",") if name.strip()]
    unknown = [name for name in (*wanted, *without) if name not in EFFECTS]
    if unknown:
        raise ConfigError(f"no effect named {', '.join(unknown)}; there are: {', '.join(EFFECTS)}")
    library = {name: EFFECTS[name] for name in EFFECTS if name in wanted and name not in without}
    if not library:
        raise ConfigError(f"--library and --without leave no effect to choose from; there are: {', '.join(EFFECTS)}")
    return library


def diagnose_with_progress(runs: "Sequence[Run]", rig: "Rig", **chosen: Any) -> "Diagnosis":
    """`dpr_lab.gap.diagnose.diagnose` with a progress bar on a terminal."""
    from dpr_lab.gap.diagnose import STEPS
    from dpr_lab.gap.diagnose import diagnose as diagnose_runs

    with progress("diagnose", len(STEPS)) as bar:
        done = 0

        def on_step(text: str) -> None:
            nonlocal done
            done += text in STEPS
            bar(done - 1, text)

        return diagnose_runs(runs, rig, on_step=on_step, **chosen)


def show(found: "Diagnosis") -> None:
    """The diagnosis on stdout: the verdict first."""
    from dpr_lab.report import gap_tables as tables

    print(found.sentence)
    print(found.where_sentence)
    if found.effects:
        table("Which effects", tables.EFFECT_COLUMNS, tables.effect_rows(found), prose=True, note=tables.EFFECT_NOTE)
    if len(found.effects) > 1:
        table("One effect after the other", tables.STEP_COLUMNS, tables.step_rows(found), note=tables.STEP_NOTE)
    if rows := tables.standing_rows(found):
        table("How sure that is", tables.STANDING_COLUMNS, rows, prose=True, note=tables.STANDING_NOTE)
    if found.effects:
        closed = f"{tables.closed_sentence(found)} {tables.CLOSED_NOTE}"
        table("How far the gap closes", tables.CLOSED_COLUMNS, tables.closed_rows(found), note=closed)
    elif found.where:
        table("Where the gap can lie", tables.PLACE_COLUMNS, tables.place_rows(found), prose=True)
    if found.sensor_findings:
        table("Sensor faults", tables.FINDING_COLUMNS, tables.finding_rows(found), prose=True)
    print("What to do next")
    for number, step in enumerate(tables.next_steps(found), 1):
        print(f"{number}. {step}")
