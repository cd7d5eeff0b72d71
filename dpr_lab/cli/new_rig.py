"""`dpr-lab rig new`: write a rig file from a few measurements.

The command asks for missing values.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dpr_lab.cli.checks import AnyJson, positive
from dpr_lab.cli.console import emit, line, say
from dpr_lab.cli.option_groups import with_groups
from dpr_lab.shown import in_command

if TYPE_CHECKING:
    from dpr_lab.workflows.rig_drive import MotorMeasures
    from dpr_lab.workflows.rig_toml import Measure

WEIGHED = "as 0.21, or as 0.21+-0.001 if weighed (a weighed mass is not identified)"
MEASURED = "as 0.042, or as 0.042+-0.001 if measured"


@dataclass(frozen=True, slots=True)
class RodOptions:
    """Options for the rods and their joints."""

    l1: Annotated[
        float | None, typer.Option("--l1", help="Distance between the two joints, m; length of a single rod.")
    ] = None
    l1_std: Annotated[
        float | None, typer.Option("--l1-std", help="Standard uncertainty of --l1, m; the diagnosis then fits L1.")
    ] = None
    l2: Annotated[float | None, typer.Option("--l2", help="Length of the outer rod, m; not with a single rod.")] = None
    m1: Annotated[str | None, typer.Option(help=f"Mass of the inner rod, kg, {WEIGHED}.")] = None
    m2: Annotated[str | None, typer.Option(help=f"Mass of the outer rod, kg, {WEIGHED}; not with a single rod.")] = None
    mb: Annotated[str | None, typer.Option(help=f"Mass of the parts at joint 2, kg, {WEIGHED}.")] = None
    rods: Annotated[Literal["both", "inner", "outer"], typer.Option(help="Mounted rods.")] = "both"
    elbow: Annotated[Literal["free", "clamped"], typer.Option(help="Whether joint 2 can turn.")] = "free"
    inner: Annotated[
        Literal["free", "prescribed"],
        typer.Option(help="Mode of the inner rod: free, or prescribed by its encoder (moved by a geared motor)."),
    ] = "free"
    geared: Annotated[list[int] | None, typer.Option(help="Joint (1 or 2) with a geared motor; may be repeated.")] = (
        None
    )

    @property
    def single(self) -> bool:
        """Whether the rig has only one rod."""
        return self.rods == "inner" and self.m2 is None and self.l2 is None

    @property
    def needed(self) -> tuple[float | str | None, ...]:
        """Values that are required for a rig file."""
        return (self.l1, self.m1) if self.single else (self.l1, self.m1, self.l2, self.m2)

    def completed(self, ask: bool) -> "RodOptions":
        """Return a copy with all required values; the user is prompted for each missing value.

        Raises:
            BadParameter: a value is missing and `ask` is False.
        """
        distance, rod = (
            ("Length of the rod, m", "rod") if self.single else ("Distance between the two joints, m", "inner rod")
        )
        l1 = self.l1 if self.l1 is not None else _asked_length(ask, "--l1", distance)
        m1 = self.m1 or _asked(ask, "--m1", f"Mass of the {rod}, kg, {WEIGHED}")
        if self.single:
            return replace(self, l1=l1, m1=m1)
        l2 = self.l2 if self.l2 is not None else _asked_length(ask, "--l2", "Length of the outer rod, m")
        m2 = self.m2 or _asked(ask, "--m2", f"Mass of the outer rod, kg, {WEIGHED}")
        mb = self.mb or (_asked(ask, "--mb", "Mass of the parts at joint 2, kg; Enter if unknown", "") if ask else None)
        return replace(self, l1=l1, m1=m1, l2=l2, m2=m2, mb=mb)


@dataclass(frozen=True, slots=True)
class EncoderOptions:
    """Options for the encoders of the joints."""

    counts_per_rev: Annotated[int | None, typer.Option(help="Counts per turn of the encoders.")] = None
    arm_counts_per_rev: Annotated[
        int | None, typer.Option(help="Counts per turn of the arm's encoder, if they differ from those of the others.")
    ] = None
    joint2: Annotated[
        Literal["relative", "absolute"] | None, typer.Option(help="Reference of the outer rod's encoder.")
    ] = None
    rezeroed: Annotated[
        bool, typer.Option("--rezeroed", help="Encoders of joints 1 and 2 are zeroed before each recording.")
    ] = False

    def prompted(self, *, two_rods: bool) -> "EncoderOptions":
        """Return a copy with all values; the user is prompted for each missing value."""
        joint2 = self.joint2
        if two_rods and joint2 is None:
            question = "Encoder of the outer rod (relative to the inner rod, or absolute)"
            joint2 = "absolute" if _asked(True, "--joint2", question, "relative").startswith("a") else "relative"
        counts = self.counts_per_rev or int(_asked(True, "--counts-per-rev", "Counts per turn", "16384", kind=int))
        return replace(self, joint2=joint2, counts_per_rev=counts)


@dataclass(frozen=True, slots=True)
class ArmOptions:
    """Options for the arm and its motor."""

    arm: Annotated[
        Literal["clamped", "free", "prescribed", "driven"],
        typer.Option(help="Mode of the arm: clamped, free, prescribed by its encoder, or driven."),
    ] = "clamped"
    l0: Annotated[float | None, typer.Option("--l0", help="Length of the arm, m.")] = None
    l0_std: Annotated[
        float | None,
        typer.Option("--l0-std", help="Standard uncertainty of --l0, m; identify then fits L0 of a moving arm."),
    ] = None
    input: Annotated[
        Literal["torque", "current", "voltage", "acceleration"] | None,
        typer.Option(help="Input of a driven arm: torque, current, voltage or acceleration."),
    ] = None
    kt: Annotated[str | None, typer.Option(help=f"Torque constant of the motor, N m/A, {MEASURED}.")] = None
    ke: Annotated[str | None, typer.Option(help=f"Back-EMF constant of the motor, V s/rad, {MEASURED}.")] = None
    resistance: Annotated[str | None, typer.Option(help=f"Resistance of the motor, ohm, {MEASURED}.")] = None
    gear: Annotated[float, typer.Option(help="Turns of the motor per turn of the arm.", callback=positive)] = 1.0

    def motor(self) -> "MotorMeasures | None":
        """Return the motor of the arm, or None if `--input` is not given.

        Raises:
            BadParameter: constants of a motor are given without `--input`, or are not valid.
        """
        from dpr_lab.workflows.rig_drive import MotorMeasures

        texts = {"kt": self.kt, "ke": self.ke, "resistance": self.resistance}
        measured = {name: _measure(f"--{name}", text, MEASURED) for name, text in texts.items() if text}
        if self.input is None:
            if measured or self.gear != 1.0:
                names = ", ".join(f"--{name}" for name in measured) or "--gear"
                raise typer.BadParameter(f"{names} requires a driven arm: give --arm driven and --input")
            return None
        return MotorMeasures(self.input, measured.get("kt"), measured.get("ke"), measured.get("resistance"), self.gear)


@with_groups
def new(
    *,
    name: Annotated[str | None, typer.Option(help="Name of the rig.")] = None,
    rods: RodOptions,
    encoders: EncoderOptions,
    arm: ArmOptions,
    g: Annotated[float, typer.Option(help="Gravity, m/s^2.")] = 9.81,
    url: Annotated[str | None, typer.Option("--link", help="Link to the device.")] = None,
    out: Annotated[Path | None, typer.Option(help="File to write. Default: NAME.toml.")] = None,
    as_json: AnyJson = False,
) -> None:
    """Write a rig file from lengths and masses.

    Plausible bounds of all parameters are added. On a terminal, the command asks for missing values.

    Example: dpr-lab rig new --name bench --l1 0.3 --l2 0.25 --m1 0.21+-0.001 --m2 0.12 --out my_rig.toml

    Example: dpr-lab rig new --name qube --rods inner --l0 0.085 --l1 0.129 --m1 0.024 --arm driven --input voltage
    """
    from dpr_lab.workflows.rig_file import RigMeasures, check_rig, new_rig

    ask = sys.stdin.isatty() and sys.stderr.isatty() and None in (name, *rods.needed)
    name = name or _asked(ask, "--name", "Name of the rig", "my_rig")
    rods = rods.completed(ask)
    if ask:
        encoders = encoders.prompted(two_rods=not rods.single)
        url = url or _asked(ask, "--link", "Link to the device", "sim://")
    assert rods.l1 is not None
    assert rods.m1 is not None
    measures = RigMeasures(
        name,
        L1=rods.l1,
        L2=rods.l2,
        m1=_measure("--m1", rods.m1),
        m2=_measure("--m2", rods.m2) if rods.m2 else None,
        mb=_measure("--mb", rods.mb) if rods.mb else None,
        g=g,
        counts_per_rev=encoders.counts_per_rev or 16384,
        joint2=encoders.joint2 or "relative",
        url=url or "sim://",
        L0=arm.l0,
        L0_std=arm.l0_std,
        L1_std=rods.l1_std,
        geared=tuple(sorted(set(rods.geared or ()))),
        rezeroed=encoders.rezeroed,
        mounted=rods.rods,
        elbow=rods.elbow,
        inner=rods.inner,
        arm=arm.arm,
        motor=arm.motor(),
        arm_counts_per_rev=encoders.arm_counts_per_rev,
    )
    file = new_rig(measures, out or Path(f"{name}.toml"))
    for finding in check_rig(file):
        if finding.state == "odd":
            say(f"warning: {finding.key}: {finding.text}")
    if as_json:
        emit({"file": file})
    else:
        line(f"{file}: review and complete this file, then run dpr-lab rig check {in_command(file)}")


def _asked(ask: bool, flag: str, question: str, default: str | None = None, kind: type = str) -> str:
    """Ask for a value on the terminal and return the answer.

    Raises:
        BadParameter: the option is missing and `ask` is False.
    """
    if not ask:
        raise typer.BadParameter(f"{flag} is required: {question}. On a terminal, the command asks for it")
    return str(typer.prompt(question, default=default, type=kind, err=True))


def _asked_length(ask: bool, flag: str, question: str) -> float:
    return float(_asked(ask, flag, question, kind=float))


def _measure(flag: str, text: str, form: str = WEIGHED) -> "Measure":
    """Parse a nominal value such as `0.21`, or a measured value such as `0.21+-0.001`.

    The second number of a measured value is its standard uncertainty.
    """
    from dpr_lab.workflows.rig_toml import Measure

    value, _, std = text.replace("±", "+-").partition("+-")
    try:
        return Measure(float(value), float(std) if std else None)
    except ValueError as error:
        raise typer.BadParameter(f"{flag} {text[:50]!r}: write the value {form}") from error
