"""Dialog that imports a recording from a different logger: options, preview, confirmation of warnings."""

import asyncio
import shlex
from functools import partial
from pathlib import Path

from textual.app import ComposeResult
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.report.text_plot import text_chart
from dpr_lab.storage.tables.understood import Understood, chart_title, names_of
from dpr_lab.tui.guard import Guarded
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.path_suggester import PathSuggester
from dpr_lab.tui.steps.table_options import option_list, parse_options
from dpr_lab.tui.widgets.dialogs import confirm
from dpr_lab.tui.widgets.key_line import KeyLine
from dpr_lab.workflows.import_table import ImportRequest, import_table, preview_table

FILE = "path of a table, .csv.gz, .mat, .npz, .h5, .parquet, .mcap, or the folder of a ROS 2 bag"
OPTIONS = "options such as --unit deg --angles relative --zero hanging --pose X1; Enter shows the preview"
WARNING = "warning: "


class TableImport(Guarded, ModalScreen[Path | None]):
    """Dialog that shows the options and the preview of `dpr-lab import table`.

    Its result is the path of the written run.

    Args:
        rig: rig file, or the name of a built-in one
        runs: folder of the run
        file: the recording; empty: entered by the operator
    """

    BINDINGS = bindings("import")
    DEFAULT_CSS = """
    TableImport { align: center middle; }
    TableImport > Vertical { width: 100%; height: 100%; background: $surface; border: round $primary; padding: 0 1; }
    TableImport Input { height: 1; }
    """

    def __init__(self, rig: str, runs: Path, file: str = "") -> None:
        super().__init__()
        self._file, self._rig, self._runs = file, rig, runs
        self._shown: tuple[ImportRequest, Understood] | None = None

    def compose(self) -> ComposeResult:
        """Build the fields for file and options, and the preview."""
        with Vertical() as page:
            page.border_title = f"Import a table, with the rig {self._rig}: nothing has been written yet"
            yield Input(self._file, placeholder=FILE, id="table", suggester=PathSuggester("*"), compact=True)
            yield Input(placeholder=OPTIONS, id="options", compact=True)
            with VerticalScroll():
                yield Static(_options_text(), id="understood", markup=False)
            yield KeyLine()

    async def on_mount(self) -> None:
        """Show the preview with default options, if the file is known."""
        self.query_one("#options" if self._file else "#table", Input).focus()
        if self._file:
            await self._preview()

    async def on_input_submitted(self, event: Input.Submitted) -> None:
        """Show the preview with the entered options; after a path, focus the options."""
        if event.input.id == "table" and Path(event.value.strip()).expanduser().exists():
            self.query_one("#options", Input).focus()
        await self._preview()

    async def _preview(self) -> None:
        """Show the preview with the entered options."""
        self._shown = None
        try:
            request = self._request()
            preview = await asyncio.to_thread(preview_table, request)
        except DprError as error:
            self._show(Content.assemble((f"{error}\n\n", "$error"), _options_text()))
            return
        self._shown = request, preview
        self._show(Content("\n").join([*_lines(preview), Content(""), _options_text()]))

    async def action_save(self) -> None:
        """Write the run as previewed; ask for confirmation if there are warnings."""
        try:
            previewed = self._shown is not None and self._shown[0] == self._request()
        except DprError:
            previewed = False
        if not previewed or self._shown is None:
            await self._preview()
            if self._shown is not None:
                self.notify("This is the preview of the import: check it, then import")
            return
        request, preview = self._shown
        if warnings := "\n".join(warnings_of(preview)):
            question = f"Import the table despite these warnings?\n\n{warnings}"
            confirm(self.app, question, "Import", "Back", partial(self._save, request))
        else:
            await self._save(request)

    async def _save(self, request: ImportRequest) -> None:
        try:
            imported = await asyncio.to_thread(import_table, request)
        except DprError as error:
            self._show(Content.styled(f"not imported: {error}", "$error"))
        else:
            self.dismiss(imported.file.resolve())

    def _show(self, content: Content) -> None:
        self.query_one("#understood", Static).update(content)

    def _request(self) -> ImportRequest:
        name = self.query_one("#table", Input).value.strip()
        if not name:
            raise ConfigError(f"no table is given: enter the {FILE}")
        options, mounting = parse_options(self.query_one("#options", Input).value)
        return ImportRequest(Path(name).expanduser(), self._rig, self._runs, options, **mounting)


def warnings_of(preview: Understood) -> list[str]:
    """Return the warnings about a table, which the operator must confirm."""
    return [question.sentence for question in preview.questions]


def _options_text() -> Content:
    return Content.styled("options, as in dpr-lab import table:\n" + "\n".join(option_list()), "dim")


def _lines(preview: Understood) -> list[Content]:
    warnings = [Content.styled(f"{WARNING}{text}", "bold $warning") for text in warnings_of(preview)]
    if preview.mend:
        warnings.append(Content.styled(f"add to the options: {shlex.join(preview.mend)}", "bold"))
    lines = [f"{name:<9}{text}" for name, text in preview.facts().items()]
    lines += ["", "".join(f"{name:>11}" for name in ("t_s", *names_of(preview.joints)))]
    lines += ["".join(f"{value:>11.5f}" for value in row) for row in preview.first_rows(3)]
    for joint in preview.joints:
        lines += ["", chart_title(joint), *text_chart(preview.t, preview.theta[:, joint], height=4)]
    return [*warnings, *map(Content, [*preview.notes, *lines])]
