"""Step Rig: choose the rig file and show its content."""

from collections.abc import Iterator
from pathlib import Path

from textual import on
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from dpr_lab.configs import built_in, find_config
from dpr_lab.errors import ConfigError
from dpr_lab.report.angles import AngleUnit
from dpr_lab.report.tables import PARAMETER_UNITS
from dpr_lab.rig import PARAMETERS, Rig, load_rig
from dpr_lab.rig_tables import INPUT_UNITS, Parameter
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.path_suggester import PathSuggester
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps.rig_editor import RigEditor
from dpr_lab.tui.steps.step import Step
from dpr_lab.tui.widgets.readout import BAD

UNNAMED = "No rig is selected: choose one from the list, or enter the path of a rig file ({rig.edit})"
_ARM = {
    "A": ("kg m²", "inertia about the arm's axis"),
    "c0": ("N m s/rad", "viscous friction of the arm"),
    "k0": ("N m/rad", "stiffness of the arm's cable"),
    "f0": ("N m", "Coulomb friction of the arm"),
    "kt": ("N m/A", "torque constant of the motor"),
    "ke": ("V s/rad", "back-EMF constant of the motor"),
    "R": ("ohm", "resistance of the motor"),
}
"""Unit and meaning of each parameter of an arm or its motor."""
CORRECT = "correct it, then press {rig.read}"


class RigStep(Step):
    """Step that shows the parameters, poses and encoders of the rig."""

    NAME = "Rig"
    HELP = """
Choose the rig file that describes your rig: a recent or built-in one from the list, or the path of your own file
(`{rig.edit}`). `{rig.write}` opens the shown file for editing; a built-in file is saved under another name. The file
is saved only if it passes all checks.

A parameter is either searched for between bounds, or measured on the bench. The identification uses the measured value
with its standard uncertainty. `{rig.read}` reads the file again after a change.

`{app.import}` imports a recording of another logger (a table, `.mat`, `.npz`, `.h5`, `.parquet`, a ROS 2 bag) with
the selected rig.
"""
    BINDINGS = bindings("rig")

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self._rig: Rig | None = None
        self._named = ""

    def compose(self) -> ComposeResult:
        """Build the list of rigs, the path field and the description."""
        yield OptionList(id="names")
        hint = "rig file (.toml), or name of a built-in rig; the right arrow completes a path"
        yield Input(placeholder=hint, id="rig_file", suggester=PathSuggester(".toml"))
        with VerticalScroll(id="described"):
            yield Static(id="description")

    def on_mount(self) -> None:
        """Read the workspace's rig."""
        self._show_name(self.workspace.rig)
        self._read()
        self._offer()

    def outcome(self) -> str:
        """Return the name of the rig; empty if the rig file cannot be used."""
        return self._rig.name if self._rig is not None else ""

    def enter(self) -> None:
        """Read the file again, because it may have changed, and focus the list of rigs."""
        if self._named != self.workspace.rig:  # the step Plan has chosen another rig file
            self._show_name(self.workspace.rig)
            self._offer()
        self.query_one(OptionList).focus()
        self._read()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return whether an action is available.

        The page can be scrolled only if it is longer than the screen.
        """
        return action != "page" or self.query_one("#described").max_scroll_y > 0

    def action_page(self, by: int) -> None:
        """Scroll through the rig."""
        described = self.query_one("#described")
        described.scroll_page_down() if by > 0 else described.scroll_page_up()

    @on(OptionList.OptionSelected)
    async def _choose(self, event: OptionList.OptionSelected) -> None:
        self.query_one(Input).value = event.option.id or ""
        await self.action_read()

    @on(Input.Submitted)
    async def action_read(self) -> None:
        """Use the rig named in the field.

        A connected device repeats its handshake with this rig.
        """
        self.services.require_free()
        name = self.query_one(Input).value.strip()
        if not name:
            raise ConfigError(self.worded(UNNAMED))
        path = Path(name).expanduser()
        hides_rig = path.is_dir() and name in built_in("rigs")
        if path.exists() and path.suffix != ".toml" and not hides_rig:
            self.query_one(Input).value = self.workspace.rig
            await self.run_action(f"app.import_table({str(path)!r})")
            return
        if path.is_file():
            name = str(path.resolve())
        changed, self.workspace.rig, self._named = name != self.workspace.rig, name, name
        self._read()
        if self._rig is not None:
            self.workspace.used(name)
            self._offer()
        self.query_one(OptionList).focus()
        if changed and self._rig is not None and self.device.connected is not None:
            await self.services.connect()
        self.changed()

    def action_write(self) -> None:
        """Open the editor for the rig file."""
        self.app.push_screen(RigEditor(find_config("rigs", self.workspace.rig)), self._written)

    async def _written(self, file: Path | None) -> None:
        if file is not None:
            self.query_one(Input).value = str(file)
            await self.action_read()

    def _show_name(self, rig: str) -> None:
        self.query_one(Input).value = self._named = rig

    def _offer(self) -> None:
        """List the recently used rigs, then the built-in rigs."""
        names = built_in("rigs")
        before = [name for name in self.workspace.recent_rigs if name not in names]
        options = [Option(Content(f"{name}  (used before)"), id=name) for name in before]
        options += [Option(Content(f"{name}  (built in)"), id=name) for name in names]
        listed = self.query_one(OptionList).clear_options().add_options(options)
        listed.highlighted = next((i for i, option in enumerate(options) if option.id == self.workspace.rig), 0)

    def action_edit(self) -> None:
        """Focus the field."""
        self.query_one(Input).focus()

    def _read(self) -> None:
        try:
            self._rig = load_rig(self.workspace.rig)
        except ConfigError as error:
            self._rig = None
            description = Content.styled(f"{BAD} {error}\n\n{self.worded(CORRECT)}", "$error")
        else:
            description = Content("\n").join(_description(self._rig, self.workspace.unit))
        shown = self.query_one("#description", Static)
        shown.set_class(self._rig is None, "-wrong")
        shown.update(description)
        self.call_after_refresh(self.refresh_bindings)


def _description(rig: Rig, unit: AngleUnit) -> Iterator[Content]:
    lengths = f"L0 {rig.L0:g} m, L1 {rig.L1:g} m" + (f", L2 {rig.L2:g} m" if rig.L2 is not None else "")
    yield Content.styled(f"{rig.name}: {lengths}, g {rig.g:g} m/s²", "bold")
    yield Content.styled(f"{'':<4}{'value':>10} {'searched or measured':<20} {'unit':<10}meaning", "dim")
    for name in _mounted(rig):
        yield _parameter(name, rig.parameters[name], *PARAMETER_UNITS[name])
    yield from _setup(rig)
    yield from _arm(rig, unit)
    yield Content.styled(f"\nposes ({unit.scale})", "dim")
    for name, pose in rig.poses.items():
        angles = unit.all_of(pose.theta[: 1 + rig.rods.number].tolist())
        yield Content(f"{name:<6} {angles}  within {unit.size(pose.tolerance)}")
    if not rig.poses:
        yield Content.styled(f"{BAD} none: add a table such as [poses.X1] with theta1 and theta2", "$warning")
    yield from _encoders(rig)


def _mounted(rig: Rig) -> tuple[str, ...]:
    """Return the names of the parameters of the mounted rods."""
    joints = {"both": "12", "inner": "1", "outer": "2"}[rig.rods.mounted]
    return tuple(name for name in PARAMETERS if name[-1] in joints or (name == "mb" and joints == "12"))


def _setup(rig: Rig) -> Iterator[Content]:
    """Describe the mounting of the rods, unless both swing freely."""
    if rig.rods.mounting != "both":
        yield Content("the elbow is clamped" if rig.rods.number == 2 else f"{rig.rods.names[0]} alone, on joint 1")
    if rig.joints.inner == "prescribed":
        yield Content("inner rod prescribed: its encoder measures the prescribed motion")
    if rig.joints.geared:
        yield Content(f"geared motor at joint {' and '.join(map(str, rig.joints.geared))}")


def _arm(rig: Rig, unit: AngleUnit) -> Iterator[Content]:
    """Describe the mode and parameters of a moving arm, and its motor."""
    arm, motor = rig.arm, rig.motor
    if arm.mode == "clamped":
        return
    drive = f" by a {motor.input} ({INPUT_UNITS[motor.input]}), gear {motor.gear:g}" if motor is not None else ""
    limits = f", from {unit.text(arm.limits[0])} to {unit.text(arm.limits[1])}" if arm.limits is not None else ""
    yield Content.styled(f"\narm {arm.mode}{drive if arm.mode == 'driven' else ''}{limits}", "dim")
    for name, row in _ARM.items():
        parameter = getattr(motor if name in ("kt", "ke", "R") else arm, name, None)
        if parameter is not None:
            yield _parameter(name, parameter, *row)


def _parameter(name: str, parameter: Parameter, unit: str, meaning: str) -> Content:
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
