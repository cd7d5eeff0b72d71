"""The run browser: what was recorded, filtered, checked, exported, and chosen for the bench."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import DataTable, Footer, Input, OptionList, Static

from dpr_lab.storage.export import EXPORTERS
from dpr_lab.tui import tasks
from dpr_lab.tui.dialogs import HELP_KEY
from dpr_lab.tui.guard import Guarded
from dpr_lab.tui.tasks import Surveyed
from dpr_lab.tui.work import Event, Failed, Finished, Job, Progress

if TYPE_CHECKING:
    from dpr_lab.storage.inspect import RunInfo

COLUMNS = ("", "pose", "recorded", "s", "lost", "state", "gate", "file")
CHOSEN, LEFT = "✔", " "


class RunBrowser(Guarded, ModalScreen[list[Path] | None]):
    """Choose runs; dismissed with the new selection, or None where it stays as it was.

    Args:
        folder: where runs are recorded, with its subfolders
        selected: what is chosen so far, wherever it is
        others: runs from elsewhere to choose from too
        title: what they are chosen for
    """

    NAME = "Runs"
    HELP = """
Choose runs: `space` takes the one under the cursor or leaves it, `a` all that are shown; `enter` ends with this choice,
`escape` with the one from before. `/` shows only those with the words you write.

`v` checks the file under the cursor: hash, chunks, ticks, end. `e` writes it in another format, to `exports/` beside
the folder of the runs.

A run whose state is *cut* ends before it was finished and gives the samples up to there; one that is *unreadable* gives
none. Why is said below the list.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("enter", "accept", "Use", id="runs.accept", priority=True),
        Binding("escape", "leave", "Leave", id="runs.leave"),
        Binding("space", "choose", "Choose", id="runs.choose"),
        Binding("a", "choose_all", "All", id="runs.all"),
        Binding("slash", "filter", "Filter", id="runs.filter"),
        Binding("v", "verify", "Verify", id="runs.verify"),
        Binding("e", "export", "Export", id="runs.export"),
        HELP_KEY,
    ]
    DEFAULT_CSS = """
    RunBrowser { align: center middle; }
    RunBrowser > Vertical { width: 100%; height: 100%; background: $surface; border: round $primary; padding: 0 1; }
    RunBrowser DataTable { height: 1fr; }
    RunBrowser #filter { height: 1; }
    RunBrowser #about { height: auto; max-height: 5; }
    RunBrowser #said { height: auto; max-height: 4; text-style: bold; }
    """

    @dataclass
    class Heard(Message):
        """Something that a job told."""

        event: Event

    def __init__(
        self,
        folder: Path,
        selected: Sequence[Path],
        others: Sequence[Path] = (),
        title: str = "Runs to work on",
    ) -> None:
        super().__init__()
        self._folder = folder
        self._purpose = title
        self._chosen = [path for path in selected if path.is_file()]
        found = {path.resolve(): path for path in (*sorted(folder.rglob("*.mcap")), *others, *self._chosen)}
        self._paths = list(found.values())
        self._chosen = [found[path.resolve()] for path in self._chosen]
        self._known: dict[Path, Surveyed] = {}
        self._jobs: list[Job] = []

    def compose(self) -> ComposeResult:
        """Filter, table, what the run under the cursor says, keys."""
        with Vertical() as page:
            page.border_title = self._purpose
            yield Input(placeholder="filter: words of pose, file, state, gate or note", id="filter", compact=True)
            yield DataTable[Text](cursor_type="row", zebra_stripes=True)
            yield Static(id="about", markup=False)
            yield Static(id="said", markup=False)
            yield Footer(show_command_palette=False, compact=True)

    def on_mount(self) -> None:
        """List the files at once, what is in them as it is read."""
        table = self._table
        for column in COLUMNS:
            table.add_column(column, key=column or "chosen")
        self._list()
        table.focus()
        if self._paths:
            self._start(tasks.survey, paths=self._paths)
        else:
            self._say(f"No runs in {self._folder} yet: record some in step 3.")

    def on_unmount(self) -> None:
        """Nobody is left to look for."""
        for job in self._jobs:
            job.cancel()

    def action_accept(self) -> None:
        """Use what is chosen; in the filter, go to the list."""
        if self._table.has_focus:
            self.dismiss(self._chosen)
        else:
            self._table.focus()

    def action_leave(self) -> None:
        """Leave the selection as it was; in the filter, go to the list."""
        if self._table.has_focus:
            self.dismiss(None)
        else:
            self._table.focus()

    def action_choose(self) -> None:
        """Choose the run under the cursor, or not."""
        if (path := self._here) is not None:
            self._mark(path, path not in self._chosen)
            self._table.action_cursor_down()

    def action_choose_all(self) -> None:
        """Choose all that are shown; none, where all are chosen."""
        shown = self._shown
        wanted = not all(path in self._chosen for path in shown)
        for path in shown:
            self._mark(path, wanted)

    def action_filter(self) -> None:
        """Narrow the list."""
        self.query_one(Input).focus()

    def action_verify(self) -> None:
        """Check hash, chunks, ticks and end."""
        if (path := self._here) is not None:
            self._say(f"checking {path.name}")
            self._start(tasks.verify, path=path)

    def action_export(self) -> None:
        """Write the run under the cursor in another format."""
        if (path := self._here) is not None:
            self.app.push_screen(FormatScreen(), partial(self._export, path))

    @property
    def _table(self) -> DataTable[Text]:
        return self.query_one(DataTable)

    @property
    def _shown(self) -> list[Path]:
        words = self.query_one(Input).value.lower().split()
        return [path for path in self._paths if all(word in self._words(path) for word in words)]

    @property
    def _here(self) -> Path | None:
        shown, row = self._shown, self._table.cursor_row
        return shown[row] if 0 <= row < len(shown) else None

    @on(Input.Changed)
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
            self._start(tasks.export, path=path, out=out)

    def _start(self, function: Callable[..., Any], **arguments: Any) -> None:
        job = Job(function, **arguments)
        self._jobs.append(job)
        self.run_worker(partial(self._listen, job), thread=True, exit_on_error=False)

    def _listen(self, job: Job) -> None:
        for event in job.events():
            self.post_message(self.Heard(event))

    @on(Heard)
    def _hear(self, message: Heard) -> None:
        match message.event:
            case Progress(Surveyed() as found):
                self._learn(found)
            case Finished(str(said)):
                self._say(said)
            case Failed() as failed:
                self.lab.mishap(failed.error)

    def _learn(self, found: Surveyed) -> None:
        self._known[found.path] = found
        if found.path in self._shown and str(found.path) in {key.value for key in self._table.rows}:
            for column, cell in zip(COLUMNS[1:], _row(found.path, found), strict=True):
                self._table.update_cell(str(found.path), column, Text(cell), update_width=True)
        else:
            self._list()
        if found.path == self._here:
            self._describe()

    def _say(self, text: str) -> None:
        self.query_one("#said", Static).update(text)


class FormatScreen(ModalScreen[str | None]):
    """In which format to export."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "dismiss", "Leave", id="format.leave")]
    DEFAULT_CSS = """
    FormatScreen { align: center middle; }
    FormatScreen OptionList { width: 40; height: auto; border: round $primary; }
    """

    def compose(self) -> ComposeResult:
        """The formats."""
        yield OptionList(*EXPORTERS)

    @on(OptionList.OptionSelected)
    def _picked(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(list(EXPORTERS)[event.option_index])


def _row(path: Path, known: Surveyed | None) -> tuple[str, ...]:
    if known is None:
        return ("", "", "", "", "reading", "", path.stem)
    if known.info is None:
        return ("", "", "", "", "unreadable", "", path.stem)
    info = known.info
    return (
        info.pose or "–",
        info.created_utc[:16].replace("T", " "),
        f"{info.duration_s:.1f}",
        str(sum(info.lost.values())),
        "whole" if info.complete else "cut",
        info.gate or "–",
        path.stem,
    )


def _about(known: Surveyed) -> str:
    if known.info is None:
        return known.trouble
    info = known.info
    said = [
        f"{info.samples} samples at {info.rate_hz:g} Hz, rig {info.rig}, {info.source} {info.url}",
        f"lost {_losses(info)}; {info.gaps} gaps, the longest {1e3 * info.longest_gap_s:.1f} ms",
        *(text for text in (info.damage, info.stopped, info.note, *info.notes) if text),
    ]
    return "\n".join(said)


def _losses(info: "RunInfo") -> str:
    causes = [f"{cause.replace('_', ' ')} {count}" for cause, count in info.lost.items() if count]
    return ", ".join(causes) or "nothing"
