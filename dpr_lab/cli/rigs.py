"""`dpr-lab rig list|show|new|from|check`: listing, creation and validation of rig files."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from dpr_lab.cli.checks import AnyJson, complete_rig, names_in, positive
from dpr_lab.cli.console import emit, line, table, text
from dpr_lab.cli.listing import command_group
from dpr_lab.cli.new_rig import new
from dpr_lab.shown import in_command

app = command_group(
    "List, show, create and check rig files. docs/rig-file.md documents every key.\n\n"
    "Example: dpr-lab rig check my_rig.toml"
)

RigFile = Annotated[str, typer.Argument(help="Rig file, or name of a built-in rig.", autocompletion=complete_rig)]


@app.command("list")
def list_(as_json: AnyJson = False) -> None:
    """List the names of the built-in rigs, which the option --rig accepts.

    Example: dpr-lab rig list
    """
    from dpr_lab.configs import built_in, find_config
    from dpr_lab.rig import load_rig

    rigs = {name: load_rig(name) for name in built_in("rigs")}
    if as_json:
        emit([{"name": name, "file": rig.path, "poses": list(rig.poses)} for name, rig in rigs.items()])
        return
    rows = [(name, ", ".join(rig.poses) or "none", find_config("rigs", name)) for name, rig in rigs.items()]
    table("Built-in rigs", ("name", "poses", "file"), rows)


@app.command()
def show(
    rig: RigFile,
    as_json: AnyJson = False,
) -> None:
    """Print a rig file after checking it.

    Example: dpr-lab rig show paper > my_rig.toml
    """
    from dpr_lab.rig import load_rig

    checked = load_rig(rig)
    assert checked.path is not None
    if as_json:
        emit(checked.model_dump(mode="json"))
    else:
        text(checked.path.read_text(encoding="utf-8").rstrip())


@app.command("from")
def from_model(
    model: Annotated[Path, typer.Argument(help="Model of a simulator: MJCF, URDF or SDFormat.")],
    joints: Annotated[
        str | None,
        typer.Option(
            help="Joints, separated by commas: inner rod, outer rod and optionally arm; or, with a single rod,"
            " rod and arm."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("rig.toml"),
    name: Annotated[str | None, typer.Option(help="Name of the rig; default: the name of the model.")] = None,
    g: Annotated[
        float | None,
        typer.Option(help="Gravity, m/s^2, downwards along z; default: the value of the model.", callback=positive),
    ] = None,
    as_json: AnyJson = False,
) -> None:
    """Write a rig file from a simulator model with two hinges.

    The hinges must be in a chain. The parts that are not imported are listed.

    Example: dpr-lab rig from robot.xml --joints shoulder,elbow --out rig.toml
    """
    from dpr_lab.workflows.rig_file import MEANING
    from dpr_lab.workflows.rig_from import rig_from_model

    read = rig_from_model(model, out, names_in(joints) or (), name, g)
    if as_json:
        emit(read.to_json())
        return
    line(f"{read.file}: from the {read.format} model {read.model}, joints {', '.join(read.joints)}")
    rows = [
        (f"{prefix}{key}", f"{value:.6g}", *MEANING[key].rsplit(", ", 1)[::-1])
        for prefix, values in (("", read.nominal), ("arm.", read.arm))
        for key, value in values.items()
    ]
    table("Nominal values", ("key", "value", "unit", "meaning"), rows)
    if read.terms:
        rows = [(term.joint, term.quantity, f"{term.value:.6g}", term.unit) for term in read.terms]
        table("Effects that a rig file cannot contain", ("joint", "quantity", "value", "unit"), rows)
    for note in read.notes:
        line(f"note: {note}")
    line(f"next: give counts_per_rev of your encoders in {read.file}, then dpr-lab rig check {in_command(read.file)}")


app.command("new")(new)


@app.command()
def check(
    rig: RigFile,
    as_json: AnyJson = False,
) -> None:
    """Check a rig file for errors, missing keys and implausible values. The exit code is 1 if the file cannot be used.

    Example: dpr-lab rig check my_rig.toml
    """
    from dpr_lab.workflows.rig_file import check_rig

    findings = check_rig(rig)
    wrong = any(finding.state == "wrong" for finding in findings)
    if as_json:
        emit({"file": rig, "ok": not wrong, "findings": [asdict(finding) for finding in findings]})
    elif findings:
        rows = [(finding.state, finding.key, finding.text) for finding in findings]
        table(f"{rig}: {'cannot be used' if wrong else 'can be used'}", ("", "key", "problem"), rows)
    else:
        line(f"{rig}: can be used; no missing keys or implausible values")
    if wrong:
        raise typer.Exit(1)
