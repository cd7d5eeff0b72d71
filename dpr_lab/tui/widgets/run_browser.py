"""Run browser: list, filter, check, export and select recorded runs."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.events import Key
from textual.screen import ModalScreen
from textual.widgets import DataTable, Input, OptionList, Static

from dpr_lab.errors import ConfigError
from dpr_lab.report.run_names import local_time, recorded
from dpr_lab.run import LOSS_WORDS
from dpr_lab.storage.export import EXPORTERS
from dpr_lab.storage.sidecar import write_note
from dpr_lab.tui.guard import Guarded
from dpr_lab.tui.jobs import jobs
from dpr_lab.tui.jobs.job_events import JobFailed, JobFinished, JobProgress
from dpr_lab.tui.jobs.job_process import JobHeard, start_job
from dpr_lab.tui.jobs.jobs import RunSurveyed
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.path_suggester import PathSuggester
from dpr_lab.tui.services import Services
from dpr_lab.tui.texts import following
from dpr_lab.tui.widgets.key_line import KeyLine

COLUMNS = ("", "pose", "recorded", "s", "lost", "state", "checks", "file")
CHOSEN, LEFT = "✔", " "


class RunBrowser(Guarded, ModalScreen[list[Path] | None]):
    """Dialog that returns a new selection of runs, or None if nothing was changed.

    Args:
        services: services with the workspace, which defines the folder of the runs
        selected: current selection, from any folder
        others: additional runs from other folders
        title: purpose of the selection
        take_here: whether an empty selection means the run under the cursor
    """

    NAME = "Runs"
    HELP = """
Select runs: `{runs.choose}` selects or deselects the run under the cursor, `{runs.all}` all shown runs. `{runs.accept}`
closes the list and uses this selection, or the run under the cursor if no run is selected. `{runs.leave}` closes the
list and keeps the previous selection. `{runs.filter}` shows only runs that contain the entered words.

`{runs.verify}` checks hash, chunks, ticks and end of the file under the cursor. `{runs.export}` writes the run in
another format, to `exports/` next to the folder of the runs. `{runs.recover}` writes the valid part of a damaged run to
an undamaged file; this run stays marked as cut. `{runs.note}` edits the note of the run under the cursor; it is stored
in a separate file, because a run file never changes.

`{runs.import}` closes the list with this selection and imports a table of another logger. The imported run is also
selected.

`{runs.folder}` lists the runs of another folder and keeps the selection. In the input field, the right arrow completes
a path, and up and down show recent folders.

A run with the state *cut* is incomplete: it contains the samples up to the interruption. An *unreadable* run contains
no samples. The reason is shown below the list.
"""
    BINDINGS = bindings("runs")
    DEFAULT_CSS = """
    RunBrowser { align: center middle; }
    RunBrowser > Vertical { width: 100%; height: 100%; background: $surface; border: round $primary; padding: 0 1; }
    RunBrowser DataTable { height: 1fr; }
    RunBrowser #filter { height: 1; }
    RunBrowser .asked { height: 1; display: none; }
    RunBrowser #about { height: auto; max-height: 5; }
    RunBrowser #result { height: auto; max-height: 4; text-style: bold; }
    """

    def __init__(
        self,
        services: Services,
        selected: Sequence[Path],
        others: Sequence[Path] = (),
        title: str = "Runs to work on",
        *,
        take_here: bool = True,
    ) -> None:
        super().__init__()
        self._services = services
        self._folder = services.workspace.out / "runs"
        self._purpose = title
        self._touched = not take_here
        self._chosen = [path for path in selected if path.is_file()]
        self._others = others
        self._paths: list[Path] = []
        self._find()
        self._known: dict[Path, RunSurveyed] = {}

    def compose(self) -> ComposeResult:
        """Build the filter, the table, the metadata of the current run, and the keys."""
        with Vertical() as page:
            page.border_title = self._purpose
            yield Input(placeholder="filter: words of pose, file, state, checks or note", id="filter", compact=True)
            yield Input(id="folder", classes="asked", suggester=PathSuggester(""), compact=True)
            yield Input(placeholder="note", id="note", classes="asked", compact=True)
            yield DataTable[Text](cursor_type="row", zebra_stripes=True)
            yield Static(id="about", markup=False)
            yield Static(id="result", markup=False)
            yield KeyLine()

    def on_mount(self) -> None:
        """List the files immediately, and add the metadata of each file as soon as they are read."""
        table = self._table
        for column in COLUMNS:
            table.add_column(column, key=column or "chosen")
        self._survey()
        table.focus()

    def action_accept(self) -> None:
        """Return the selected runs, or the run under the cursor.

        In a field, accept its text and focus the list.
        """
        if self.query_one("#folder").has_focus:
            name = self.query_one("#folder", Input).value.strip()
            self._look_in(Path(name).expanduser() if name else self._folder)
        elif self.query_one("#note").has_focus:
            self._keep_note(self.query_one("#note", Input).value)
        elif self._table.has_focus:
            highlighted = [self._here] if self._here is not None and not self._touched else []
            self.dismiss(self._chosen or highlighted)
        else:
            self._to_list()

    def action_leave(self) -> None:
        """Close with the previous selection; in a field, focus the list."""
        if self._table.has_focus:
            self.dismiss(None)
        else:
            self._to_list()

    def action_import_table(self) -> None:
        """Return the selection, then open the import of a table."""
        self.dismiss(self._chosen if self._touched else None)
        self.app.call_later(self.app.run_action, "app.import_table")

    def action_choose(self) -> None:
        """Select or deselect the run under the cursor."""
        self._touched = True
        if (path := self._here) is not None:
            self._mark(path, path not in self._chosen)
            self._table.action_cursor_down()

    def action_choose_all(self) -> None:
        """Select all listed runs; if all are selected, deselect them."""
        self._touched, shown = True, self._shown
        wanted = not all(path in self._chosen for path in shown)
        for path in shown:
            self._mark(path, wanted)

    def action_filter(self) -> None:
        """Focus the filter."""
        self.query_one("#filter").focus()

    def action_edit(self) -> None:
        """Edit the note of the run under the cursor."""
        known = self._known.get(self._here) if self._here is not None else None
        if known is not None and known.info is not None:
            self._ask("note", known.info.note)

    def action_other(self) -> None:
        """Ask for another folder."""
        self._ask("folder", f"{self._folder}/")

    def action_verify(self) -> None:
        """Verify hash, chunks, ticks and end of the run under the cursor."""
        if (path := self._here) is not None:
            self._say(f"checking {path.name}")
            start_job(self, jobs.verify, path=path)

    def action_export(self) -> None:
        """Write the run under the cursor in another format."""
        if (path := self._here) is not None:
            self.app.push_screen(FormatScreen(), partial(self._export, path))

    def action_recover(self) -> None:
        """Write the valid part of a damaged run to a new file in its folder."""
        if (path := self._here) is not None:
            out = path.with_name(f"{path.stem}-recovered{path.suffix}")
            self._say(f"recovering {path.name}")
            start_job(self, jobs.recover, path=path, out=out)

    def on_key(self, event: Key) -> None:
        """Show recent folders when up or down is pressed in the folder field."""
        field, recent = self.query_one("#folder", Input), list(map(str, self._services.workspace.recent_folders))
        if field.has_focus and event.key in ("up", "down") and recent:
            field.value = following(recent, field.value.rstrip("/"), 1 if event.key == "down" else -1)
            event.stop()

    def _ask(self, name: str, value: str) -> None:
        field = self.query_one(f"#{name}", Input)
        field.display, field.value = True, value
        field.focus()

    def _to_list(self) -> None:
        for field in self.query(".asked"):
            field.display = False
        self._table.focus()

    def _look_in(self, folder: Path) -> None:
        if not folder.is_dir():
            raise ConfigError(f"{folder}: no such folder")
        self._folder = folder.resolve()
        self._services.workspace.looked_at(self._folder)
        self._to_list()
        self._find()
        self._survey()

    def _keep_note(self, note: str) -> None:
        if (path := self._here) is not None:
            write_note(path, note)
            self._to_list()
            start_job(self, jobs.survey, paths=[path])

    def _find(self) -> None:
        """List the runs of the folder, the additional runs and the selected runs, without duplicates."""
        by_path = {
            path.resolve(): path for path in (*sorted(self._folder.rglob("*.mcap")), *self._others, *self._chosen)
        }
        self._paths = list(by_path.values())
        self._chosen = [by_path[path.resolve()] for path in self._chosen]

    def _survey(self) -> None:
        """List the files, then start to read the metadata of the files."""
        self._list()
        self._say("")
        if self._paths:
            start_job(self, jobs.survey, paths=self._paths)
        else:
            step = self._services.key_of("Capture")
            other = self._services.keys.key_for("runs.folder")
            self._say(f"No runs in {self._folder} yet: record some in step {step}, or choose another folder ({other}).")

    @property
    def _table(self) -> DataTable[Text]:
        return self.query_one(DataTable)

    @property
    def _shown(self) -> list[Path]:
        words = self.query_one("#filter", Input).value.lower().split()
        return [path for path in self._paths if all(word in self._words(path) for word in words)]

    @property
    def _here(self) -> Path | None:
        shown, row = self._shown, self._table.cursor_row
        return shown[row] if 0 <= row < len(shown) else None

    @on(Input.Changed, "#filter")
    def _list(self) -> None:
        table = self._table
        table.clear()
        for path in self._shown:
            table.add_row(*(Text(cell) for cell in self._cells(path)), key=str(path))

    @on(DataTable.RowHighlighted)
    def _describe(self) -> None:
        if (path := self._here) is not None and path in self._known:
            self.query_one("#about", Static).update(_about(self._known[path]))

    def _cells(self, path: Path) -> tuple[str, ...]:
        return (CHOSEN if path in self._chosen else LEFT, *_row(path, self._known.get(path)))

    def _words(self, path: Path) -> str:
        known = self._known.get(path)
        note = known.info.note if known is not None and known.info is not None else ""
        return " ".join((*_row(path, known), note)).lower()

    def _mark(self, path: Path, chosen: bool) -> None:
        self._chosen = [other for other in self._paths if (chosen if other == path else other in self._chosen)]
        self._table.update_cell(str(path), "chosen", Text(CHOSEN if chosen else LEFT))

    def _export(self, path: Path, suffix: str | None) -> None:
        if suffix is not None:
            out = self._folder.parent / "exports" / f"{path.stem}{suffix}"
            self._say(f"writing {out}")
            start_job(self, jobs.export, path=path, out=out)

    @on(JobHeard)
    def _hear(self, message: JobHeard) -> None:
        match message.event:
            case JobProgress(RunSurveyed() as survey):
                self._learn(survey)
            case JobFinished(str(text)):
                self._say(text)
            case JobFailed() as failed:
                raise failed.error

    def _learn(self, survey: RunSurveyed) -> None:
        self._known[survey.path] = survey
        read = sum(path in self._known for path in self._paths)
        self._say(f"read {read} of {len(self._paths)}" if read < len(self._paths) else "")
        if survey.path in self._shown and str(survey.path) in {key.value for key in self._table.rows}:
            for column, cell in zip(COLUMNS[1:], _row(survey.path, survey), strict=True):
                self._table.update_cell(str(survey.path), column, Text(cell), update_width=True)
        else:
            self._list()
        if survey.path == self._here:
            self._describe()

    def _say(self, text: str) -> None:
        self.query_one("#result", Static).update(text)


class FormatScreen(ModalScreen[str | None]):
    """Dialog for the selection of an export format."""

    BINDINGS = bindings("format")
    DEFAULT_CSS = """
    FormatScreen { align: center middle; }
    FormatScreen OptionList { width: 40; height: auto; border: round $primary; }
    """

    def compose(self) -> ComposeResult:
        """Build the list of available formats."""
        yield OptionList(*EXPORTERS)

    @on(OptionList.OptionSelected)
    def _picked(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(list(EXPORTERS)[event.option_index])


def _row(path: Path, known: RunSurveyed | None) -> tuple[str, ...]:
    if known is None or known.info is None:
        return ("", "", "", "", "reading" if known is None else "unreadable", "", path.stem)
    info = known.info
    return (
        info.pose or "–",
        recorded(path, seconds=True) or local_time(info.recorded_utc, seconds=True) or "–",
        f"{info.duration_s:.1f}",
        str(sum(info.lost.values())),
        "whole" if info.complete else "cut",
        info.gate.partition(":")[0] or "–",
        path.stem,
    )


def _about(known: RunSurveyed) -> str:
    if known.info is None:
        return known.trouble
    info = known.info
    lost = ", ".join(f"{LOSS_WORDS.get(cause, cause)} {count}" for cause, count in info.lost.items() if count)
    reasons = info.gate if ":" in info.gate else ""  # why the quality gate did not rate the run "ok"
    lines = [
        f"{info.samples} samples at {info.rate_hz:g} Hz, rig {info.rig}, {info.source} {info.url}",
        f"lost {lost or 'nothing'}; {info.gaps} interruptions, the longest {1e3 * info.longest_gap_s:.1f} ms",
        *filter(None, (reasons, info.damage, info.stopped, info.note, *info.notes)),
    ]
    return "\n".join(lines)
