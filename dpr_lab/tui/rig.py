"""Step 2: choose the rig and see what is known of it."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from dpr_lab.configs import BUILTIN
from dpr_lab.errors import ConfigError
from dpr_lab.report.tables import PARAMETER_UNITS
from dpr_lab.rig import PARAMETERS, Parameter, Rig, load_rig
from dpr_lab.tui.readout import BAD
from dpr_lab.tui.step import Step


class RigStep(Step):
    """The rig's parameters, poses and encoders."""

    NAME = "Rig"
    HELP = """
Choose the rig file that describes your rig: one of the built-in ones from the list, or `i` and the path of your own
(start from a copy of `configs/rigs/paper.toml`).

A parameter is either searched for between bounds, or measured on the bench with a standard uncertainty, with which it
then enters the identification. `u` reads the file again after you changed it.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("i", "edit", "Path", id="rig.edit"),
        Binding("u", "read", "Read again", id="rig.read"),
    ]

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._rig: Rig | None = None

    def compose(self) -> ComposeResult:
        """Names, a field for a path, the rig."""
        names = sorted(path.stem for path in (BUILTIN / "rigs").glob("*.toml"))
        yield OptionList(*(Option(f"{name}  (built in)", id=name) for name in names), id="names")
        yield Input(placeholder="rig file (.toml), or a built-in name", id="rig_file")
        with VerticalScroll(id="described"):
            yield Static(id="description")

    def on_mount(self) -> None:
        """Read the bench's rig."""
        self.query_one(Input).value = self.bench.rig
        self._read()

    def outcome(self) -> str:
        """Its name."""
        return self._rig.name if self._rig is not None else ""

    def enter(self) -> None:
        """Read the file again: it may have changed."""
        self._read()

    @on(OptionList.OptionSelected)
    async def _choose(self, event: OptionList.OptionSelected) -> None:
        self.query_one(Input).value = event.option.id or ""
        await self.action_read()

    @on(Input.Submitted)
    async def action_read(self) -> None:
        """Take the rig in the field; a connected device is greeted again for it."""
        self.lab.line.require_free()
        name = self.query_one(Input).value.strip()
        if Path(name).is_file():
            name = str(Path(name).resolve())
        changed, self.bench.rig = name != self.bench.rig, name
        self._read()
        self.focus()
        self.post_message(self.Done())
        if changed and self._rig is not None and self.lab.line.connected is not None:
            await self.lab.connect()

    def action_edit(self) -> None:
        """Go to the field."""
        self.query_one(Input).focus()

    def _read(self) -> None:
        try:
            self._rig = load_rig(self.bench.rig)
        except ConfigError as error:
            self._rig = None
            said = Content.styled(f"{BAD} {error}\n\ncorrect it, then press u", "$error")
        else:
            said = Content("\n").join(_description(self._rig))
        self.query_one("#description", Static).update(said)


def _description(rig: Rig) -> Iterator[Content]:
    frame = rig.rig
    lengths = f"L0 {frame.L0:g} m, L1 {frame.L1:g} m" + (f", L2 {frame.L2:g} m" if frame.L2 is not None else "")
    yield Content.styled(f"{rig.name}: {lengths}, g {frame.g:g} m/s²", "bold")
    yield Content.styled(f"{'':<4}{'value':>10} {'searched or measured':<20} {'unit':<10}what it is", "dim")
    for name in PARAMETERS:
        yield _parameter(name, rig.parameters[name])
    yield Content.styled("\nposes (0° upright, 180° hanging)", "dim")
    for name, pose in rig.poses.items():
        theta0, theta1, theta2 = (f"{angle:.1f}°" for angle in _degrees(pose.theta.tolist()))
        within = _degrees([pose.tolerance])[0]
        yield Content(f"{name:<6} θ0 {theta0:>7}  θ1 {theta1:>7}  θ2 {theta2:>7}  within {within:.1f}°")
    if not rig.poses:
        yield Content.styled(f"{BAD} none: add a table such as [poses.X1] with theta1 and theta2", "$warning")
    yield from _encoders(rig)


def _parameter(name: str, parameter: Parameter) -> Content:
    unit, meaning = PARAMETER_UNITS[name]
    if parameter.measured is not None:
        value, fixed = parameter.measured, f"measured ± {parameter.std:g}"
    else:
        value, fixed = parameter.nominal, f"{parameter.lower:g} … {parameter.upper:g}"
    return Content(f"{name:<4}{value:>10g} {fixed:<20} {unit:<10}{meaning}")


def _encoders(rig: Rig) -> Iterator[Content]:
    encoders = rig.encoders
    yield Content.styled("\nencoders", "dim")
    yield Content(
        f"counts per turn {', '.join(map(str, encoders.counts_per_rev))}, noise {encoders.noise_counts:g} counts"
    )
    yield Content(f"zero at {', '.join(map(str, encoders.zero_counts))} counts, joint 2 reads {encoders.joint2} angles")
    if rig.added_mass is not None:
        mass = rig.added_mass
        yield Content(f"added mass {mass.mass:g} kg on the {mass.rod} rod, {mass.position:g} m from its pivot")
    yield Content(f"link {rig.link.url} at {rig.link.rate_hz} Hz")


def _degrees(angles: list[float]) -> list[float]:
    return [math.degrees(angle) for angle in angles]
