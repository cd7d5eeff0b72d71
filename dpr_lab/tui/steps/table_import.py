"""A recording of another logger, looked at before it becomes a run."""

import asyncio
from pathlib import Path
from typing import Any, ClassVar, get_args

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from dpr_lab.errors import DprError, RunError
from dpr_lab.report.text_plot import text_plot
from dpr_lab.storage.csv_import import Angles, ArmKind, ImportOptions, TimeUnit, TorqueChoice, Unit, Zero
from dpr_lab.storage.tables.columns import AXES
from dpr_lab.storage.tables.preview import Preview
from dpr_lab.tui.guard import Guarded
from dpr_lab.tui.widgets.key_line import KeyLine
from dpr_lab.workflows.import_table import ImportRequest, import_table, preview_table

WORDS = {"angles": Angles, "zero": Zero, "unit": Unit, "time_unit": TimeUnit}
NAMED = {"torque": TorqueChoice, "arm": ArmKind}
NUMBERS = ("rate_hz", "wrap", "start_s", "duration_s")
HINT = (
    "relative hanging deg ms t=COLUMN theta1=COLUMN theta2=COLUMN take=NAME rate_hz=200 wrap=360 pose=X1"
    " torque=measured arm=prescribed"
)


class TableImport(Guarded, ModalScreen[Path | None]):
    """What is understood of a file with what is said of it; dismissed with the run that was written.

    Args:
        file: the recording
        rig: rig file, or the name of a built-in one
        runs: folder of the run
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+s", "save", "Import", id="import.save", priority=True),
        Binding("escape", "dismiss", "Leave", id="import.leave"),
    ]
    DEFAULT_CSS = """
    TableImport { align: center middle; }
    TableImport > Vertical { width: 100%; height: 100%; background: $surface; border: round $primary; padding: 0 1; }
    TableImport Input { height: 1; }
    """

    def __init__(self, file: Path, rig: str, runs: Path) -> None:
        super().__init__()
        self._file, self._rig, self._runs = file, rig, runs

    def compose(self) -> ComposeResult:
        """What is said of the file, and what was understood."""
        with Vertical() as page:
            page.border_title = f"Import {self._file.name}: nothing written yet"
            yield Input(placeholder=HINT, id="said", compact=True)
            with VerticalScroll():
                yield Static("reading", id="understood", markup=False)
            yield KeyLine()

    async def on_mount(self) -> None:
        """Look at the file as it is."""
        self.query_one(Input).focus()
        await self.on_input_submitted()

    async def on_input_submitted(self) -> None:
        """Look at it with what is said now."""
        try:
            found = await asyncio.to_thread(preview_table, self._request())
        except DprError as error:
            shown = Content.styled(f"{error}\n\nsay more above, then Enter: {HINT}", "$error")
        else:
            shown = Content("\n".join(_lines(found)))
        self.query_one("#understood", Static).update(shown)

    async def action_save(self) -> None:
        """Write the run."""
        try:
            imported = await asyncio.to_thread(import_table, self._request())
        except DprError as error:
            self.query_one("#understood", Static).update(Content.styled(f"not imported: {error}", "$error"))
        else:
            self.dismiss(imported.file.resolve())

    def _request(self) -> ImportRequest:
        return ImportRequest(self._file, self._rig, self._runs, options_of(self.query_one(Input).value))


def options_of(said: str) -> ImportOptions:
    """How a table is to be read, in words such as `relative hanging deg t=time rate_hz=200`.

    Raises:
        RunError: a word that says nothing.
    """
    options: dict[str, Any] = {"unit": None, "time_unit": None}
    columns: dict[str, str] = {}
    for word in said.split():
        name, _, value = word.partition("=")
        about = next((about for about, known in WORDS.items() if word in get_args(known)), None)
        if about is not None:
            options[about] = word
        elif value and name in ("t", *AXES):
            columns[name] = value
        elif value and name in NUMBERS:
            options[name] = _number(word, value)
        elif name in NAMED and value in get_args(NAMED[name]):
            options[name] = value
        elif value and name in ("take", "pose"):
            options[name] = tuple(value.split(",")) if name == "take" else value
        else:
            raise RunError(f"{word!r} says nothing of a table; there are: {HINT}")
    try:
        return ImportOptions(columns=columns, **options)
    except ValueError as error:
        raise RunError(str(error)) from error


def _number(word: str, value: str) -> float:
    try:
        return float(value)
    except ValueError as error:
        raise RunError(f"{word!r} needs a number") from error


def _lines(found: Preview) -> list[str]:
    lines = [f"{name:<9}{text}" for name, text in found.facts().items()]
    lines += ["", f"{'t_s':>11}" + "".join(f"{axis:>11}" for axis in AXES)]
    lines += ["".join(f"{value:>11.5f}" for value in row) for row in found.first_rows(3)]
    for axis in (1, 2):
        lines += ["", AXES[axis], *text_plot(found.t, found.theta[:, axis], height=4)]
    return [*lines, "", *found.notes]
