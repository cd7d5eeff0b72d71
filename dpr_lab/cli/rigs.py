"""`dpr-lab rig list|show|new|from|check`: built-in rig files, creation and validation of rig files."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dpr_lab.cli.checks import built_in_rigs, complete_rig, names_in, positive
from dpr_lab.cli.console import emit, json_mode, line, table, text
from dpr_lab.cli.listing import Listing

if TYPE_CHECKING:
    from dpr_lab.workflows.rig_drive import MotorMeasures
    from dpr_lab.workflows.rig_toml import Measure

app = typer.Typer(
    help="List, show, create and check rig files (docs/rig-file.md documents every key).",
    cls=Listing,
    no_args_is_help=True,
    rich_markup_mode=None,
)

Json = Annotated[bool, typer.Option("--json", help="JSON on stdout.")]


@app.command("list")
def list_(as_json: Json = False) -> None:
    """List the built-in rigs, for --rig.

    Example: dpr-lab rig list
    """
    json_mode(as_json)
    from dpr_lab.configs import find_config
    from dpr_lab.rig import load_rig

    rigs = {name: load_rig(name) for name in built_in_rigs()}
    if as_json:
        emit([{"name": name, "file": str(rig.path), "poses": list(rig.poses)} for name, rig in rigs.items()])
        return
    rows = [(name, ", ".join(rig.poses) or "none", find_config("rigs", name)) for name, rig in rigs.items()]
    table("Built-in rigs", ("name", "poses", "file"), rows)


@app.command()
def show(
    rig: Annotated[str, typer.Argument(help="Rig file, or the name of a built-in one.", autocompletion=complete_rig)],
    as_json: Json = False,
) -> None:
    """Print a rig file after checking it.

    Example: dpr-lab rig show paper > my_rig.toml
    """
    json_mode(as_json)
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
            help="Joints of the inner rod, the outer rod and optionally the arm, or of one rod and its arm, separated"
            " by commas."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="File to write.")] = Path("rig.toml"),
    name: Annotated[str | None, typer.Option(help="Name of the rig; default: the name of the model.")] = None,
    g: Annotated[
        float | None,
        typer.Option(help="Gravity, m/s^2, downwards along z; default: the value of the model.", callback=positive),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a rig file from a simulator model with two hinges in a chain, and list the parts that are not imported.

    Example: dpr-lab rig from robot.xml --joints shoulder,elbow --out rig.toml
    """
    json_mode(as_json)
    from dpr_lab.workflows.rig_from import MEANING, rig_from_model

    read = rig_from_model(model, out, names_in(joints) or (), name, g)
    if as_json:
        emit(read.to_json())
        return
    line(f"{read.file}: from the {read.format} model {read.model}, joints {', '.join(read.joints)}")
    rows = [(key, f"{value:.6g}", *MEANING[key].rsplit(", ", 1)[::-1]) for key, value in read.nominal.items()]
    rows += [(f"arm.{key}", f"{value:.6g}", *MEANING[key].rsplit(", ", 1)[::-1]) for key, value in read.arm.items()]
    table("Nominal values", ("key", "value", "unit", "meaning"), rows)
    if read.terms:
        rows = [(term.joint, term.quantity, f"{term.value:.6g}", term.unit) for term in read.terms]
        table(
            "Effects that a rig file cannot contain",
            ("joint", "quantity", "value", "unit"),
            rows,
        )
    for note in read.notes:
        line(f"note: {note}")
    line(f"next: give counts_per_rev of your encoders in {read.file}, then dpr-lab rig check {read.file}")


Weighed = "as 0.21, or as 0.21+-0.001 if weighed (then not identified)"
Measured = "as 0.042, or as 0.042+-0.001 if measured"


@app.command()
def new(
    name: Annotated[str | None, typer.Option(help="Name of the rig.")] = None,
    l0: Annotated[float | None, typer.Option("--l0", help="Length of the arm, m.")] = None,
    l0_std: Annotated[
        float | None,
        typer.Option("--l0-std", help="Standard uncertainty of --l0, m; identify then fits L0 of a moving arm."),
    ] = None,
    l1: Annotated[
        float | None, typer.Option("--l1", help="Distance between the two joints, m; length of a single rod.")
    ] = None,
    l1_std: Annotated[
        float | None, typer.Option("--l1-std", help="Standard uncertainty of --l1, m; the diagnosis then fits L1.")
    ] = None,
    l2: Annotated[float | None, typer.Option("--l2", help="Length of the outer rod, m; not with a single rod.")] = None,
    m1: Annotated[str | None, typer.Option(help=f"Mass of the inner rod, kg, {Weighed}.")] = None,
    m2: Annotated[
        str | None, typer.Option(help=f"Mass of the outer rod, kg, {Weighed}; not with a single rod.")
    ] = None,
    mb: Annotated[str | None, typer.Option(help=f"Mass of the parts at joint 2, kg, {Weighed}.")] = None,
    g: Annotated[float, typer.Option(help="Gravity, m/s^2.")] = 9.81,
    counts_per_rev: Annotated[int | None, typer.Option(help="Counts per turn of the encoders.")] = None,
    arm_counts_per_rev: Annotated[
        int | None, typer.Option(help="Counts per turn of the arm's encoder, if they differ from those of the others.")
    ] = None,
    joint2: Annotated[
        Literal["relative", "absolute"] | None, typer.Option(help="Reference of the outer rod's encoder.")
    ] = None,
    rezeroed: Annotated[
        bool, typer.Option("--rezeroed", help="Encoders of joints 1 and 2 are zeroed before each recording.")
    ] = False,
    geared: Annotated[
        list[int] | None, typer.Option(help="Joint (1 or 2) with a geared motor; may be repeated.")
    ] = None,
    rods: Annotated[Literal["both", "inner", "outer"], typer.Option(help="Mounted rods.")] = "both",
    elbow: Annotated[Literal["free", "clamped"], typer.Option(help="Whether joint 2 can turn.")] = "free",
    inner: Annotated[
        Literal["free", "prescribed"],
        typer.Option(help="Mode of the inner rod: free, or prescribed by its encoder (moved by a geared motor)."),
    ] = "free",
    arm: Annotated[
        Literal["clamped", "free", "prescribed", "driven"],
        typer.Option(help="Mode of the arm: clamped, free, prescribed by its encoder, or driven."),
    ] = "clamped",
    input_: Annotated[
        Literal["torque", "current", "voltage", "acceleration"] | None,
        typer.Option("--input", help="Input of a driven arm: torque, current, voltage or acceleration."),
    ] = None,
    kt: Annotated[str | None, typer.Option(help=f"Torque constant of the motor, N m/A, {Measured}.")] = None,
    ke: Annotated[str | None, typer.Option(help=f"Back-EMF constant of the motor, V s/rad, {Measured}.")] = None,
    resistance: Annotated[str | None, typer.Option(help=f"Resistance of the motor, ohm, {Measured}.")] = None,
    gear: Annotated[float, typer.Option(help="Turns of the motor per turn of the arm.", callback=positive)] = 1.0,
    url: Annotated[str | None, typer.Option("--link", help="Link to the device.")] = None,
    out: Annotated[Path | None, typer.Option(help="File to write; default: NAME.toml.")] = None,
    as_json: Json = False,
) -> None:
    """Write a rig file from lengths and masses, with plausible bounds. On a terminal, missing values are prompted for.

    Example: dpr-lab rig new --name bench --l1 0.3 --l2 0.25 --m1 0.21+-0.001 --m2 0.12 --out my_rig.toml

    Example: dpr-lab rig new --name qube --rods inner --l0 0.085 --l1 0.129 --m1 0.024 --arm driven --input voltage
    """
    json_mode(as_json)
    from dpr_lab.workflows.rig_file import RigMeasures, new_rig

    single_rod = rods == "inner" and m2 is None and l2 is None
    needed = (name, l1, m1) if single_rod else (name, l1, l2, m1, m2)
    ask = sys.stdin.isatty() and sys.stderr.isatty() and None in needed
    name = name or _asked(ask, "--name", "Name of the rig", "my_rig")
    distance = "Length of the rod, m" if single_rod else "Distance between the two joints, m"
    l1 = l1 if l1 is not None else float(_asked(ask, "--l1", distance, kind=float))
    m1 = m1 or _asked(ask, "--m1", f"Mass of the {'rod' if single_rod else 'inner rod'}, kg, {Weighed}")
    if not single_rod:
        l2 = l2 if l2 is not None else float(_asked(ask, "--l2", "Length of the outer rod, m", kind=float))
        m2 = m2 or _asked(ask, "--m2", f"Mass of the outer rod, kg, {Weighed}")
    if ask and not single_rod:
        mb = mb or _asked(ask, "--mb", "Mass of the parts at joint 2, kg; Enter if unknown", "")
        question = "Encoder of the outer rod (relative to the inner rod, or absolute)"
        joint2 = joint2 or ("absolute" if _asked(ask, "--joint2", question, "relative").startswith("a") else "relative")
    if ask:
        counts_per_rev = counts_per_rev or int(_asked(ask, "--counts-per-rev", "Counts per turn", "16384", kind=int))
        url = url or _asked(ask, "--link", "Link to the device", "sim://")
    measures = RigMeasures(
        name,
        l1,
        l2,
        _measure("--m1", m1),
        _measure("--m2", m2) if m2 else None,
        _measure("--mb", mb) if mb else None,
        g,
        counts_per_rev or 16384,
        joint2 or "relative",
        url or "sim://",
        l0,
        l0_std,
        l1_std,
        tuple(sorted(set(geared or ()))),
        rezeroed,
        rods,
        elbow,
        inner,
        arm,
        _motor(input_, {"kt": kt, "ke": ke, "resistance": resistance}, gear),
        arm_counts_per_rev,
    )
    file = new_rig(measures, out or Path(f"{name}.toml"))
    if as_json:
        emit({"file": str(file)})
    else:
        line(f"{file}: review and complete this file, then run dpr-lab rig check {file}")


@app.command()
def check(
    rig: Annotated[str, typer.Argument(help="Rig file, or the name of a built-in one.", autocompletion=complete_rig)],
    as_json: Json = False,
) -> None:
    """Check a rig file for errors, missing keys and implausible values. The exit code is 1 if it cannot be used.

    Example: dpr-lab rig check my_rig.toml
    """
    json_mode(as_json)
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


def _asked(ask: bool, flag: str, question: str, default: str | None = None, kind: type = str) -> str:
    """The answer on a terminal; without a terminal, the option is required."""
    if not ask:
        raise typer.BadParameter(f"{flag} is required: {question}; on a terminal it is prompted for")
    return str(typer.prompt(question, default=default, type=kind, err=True))


def _measure(flag: str, text: str, form: str = Weighed) -> "Measure":
    """Parse `0.21`, or `0.21+-0.001` for a weighed value that is not identified."""
    from dpr_lab.workflows.rig_toml import Measure

    value, _, std = text.replace("±", "+-").partition("+-")
    try:
        return Measure(float(value), float(std) if std else None)
    except ValueError as error:
        raise typer.BadParameter(f"{flag} {text[:50]!r}: write the value {form}") from error


def _motor(
    input_: Literal["torque", "current", "voltage", "acceleration"] | None,
    constants: dict[str, str | None],
    gear: float,
) -> "MotorMeasures | None":
    """The motor of the options; None without `--input`."""
    from dpr_lab.workflows.rig_drive import MotorMeasures

    given = {name: _measure(f"--{name}", text, Measured) for name, text in constants.items() if text}
    if input_ is None:
        if given or gear != 1.0:
            names = ", ".join(f"--{name}" for name in given) or "--gear"
            raise typer.BadParameter(f"{names} needs the input of the motor: give --arm driven and --input")
        return None
    return MotorMeasures(input_, given.get("kt"), given.get("ke"), given.get("resistance"), gear)
