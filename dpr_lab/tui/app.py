"""The app: a stepper on top, the step that is shown below it, keys at the foot."""

import traceback
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import ClassVar

from textual import on
from textual.app import App, ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.dom import DOMNode
from textual.screen import Screen
from textual.widgets import ContentSwitcher, Footer
from textual.worker import WorkerFailed

from dpr_lab.errors import DprError
from dpr_lab.tui.bench import Bench
from dpr_lab.tui.capture import CaptureStep
from dpr_lab.tui.chart import Chart
from dpr_lab.tui.compare import CompareStep
from dpr_lab.tui.connect import ConnectStep
from dpr_lab.tui.diagnose import DiagnoseStep
from dpr_lab.tui.dialogs import HELP_KEY, HelpScreen, Question
from dpr_lab.tui.guard import Guarded
from dpr_lab.tui.identify import IdentifyStep
from dpr_lab.tui.keys import Keymap
from dpr_lab.tui.line import Line
from dpr_lab.tui.rig import RigStep
from dpr_lab.tui.runs import RunBrowser
from dpr_lab.tui.slider import Slider
from dpr_lab.tui.step import ERROR_S, Step
from dpr_lab.tui.stepper import Standing, Stepper
from dpr_lab.tui.themes import THEMES

STEPS: tuple[type[Step], ...] = (ConnectStep, RigStep, CaptureStep, IdentifyStep, CompareStep, DiagnoseStep)
"""The steps in the order of the work."""

KEYED: tuple[type[DOMNode], ...] = (*STEPS, Chart, Slider, RunBrowser)
"""Whose actions can be given other keys, besides the app's own."""

LISTEN_HZ = 15
"""How often the recorder is listened to, and so how often a step is redrawn at most."""


class DprApp(Guarded, App[None]):
    """The bench screen.

    Args:
        bench: what the operator works on
        folder: where the bench is saved and unexpected errors are logged
        keymap: the operator's keys, see `dpr_lab.tui.keys`
        notices: what to say first
        steps: the steps to show
    """

    TITLE = "dpr-lab"
    CSS_PATH = Path(__file__).with_name("app.tcss")
    BINDINGS: ClassVar[list[BindingType]] = [
        *(Binding(str(number), f"go({number})", show=False, id=f"app.step_{number}") for number in range(1, 7)),
        Binding("n,ctrl+right", "move(1)", "Next", id="app.next"),
        Binding("p,ctrl+left", "move(-1)", "Previous", id="app.previous", show=False),
        HELP_KEY,
        Binding("b", "browse", "Runs", id="app.browse"),
        Binding("t", "next_theme", "Theme", show=False, id="app.theme"),
        Binding("escape", "leave", show=False, id="app.leave"),
        Binding("ctrl+q", "quit", "Quit", id="app.quit", priority=True),
    ]

    def __init__(
        self,
        bench: Bench,
        folder: Path,
        keymap: Keymap | None = None,
        notices: Sequence[str] = (),
        steps: Sequence[type[Step]] = STEPS,
    ) -> None:
        super().__init__()
        self.bench = bench
        self.folder = folder
        self.line = Line(folder / "recorder.log")
        self._notices = notices
        self.steps = [step(id=step.NAME.lower()) for step in steps]
        for theme in THEMES:
            self.register_theme(theme)
        self.theme = bench.theme if bench.theme in self.available_themes else THEMES[0].name
        self.set_keymap(keymap or {})

    def compose(self) -> ComposeResult:
        """Stepper, step, keys."""
        yield Stepper(id="stepper")
        with ContentSwitcher(id="steps"):
            yield from self.steps
        yield Footer(show_command_palette=False)

    def on_mount(self) -> None:
        """Resume at the step shown last."""
        self.theme_changed_signal.subscribe(self, lambda theme: self._keep_theme(theme.name))
        self.set_interval(1 / LISTEN_HZ, self._listen)
        last = next((i for i, step in enumerate(self.steps, 1) if self.bench.step == step.NAME), 1)
        self.action_go(last)
        for notice in self._notices:
            self.notify(notice, severity="warning", timeout=ERROR_S, markup=False)

    async def on_unmount(self) -> None:
        """Leave no process behind."""
        await self.line.close()

    async def connect(self) -> None:
        """Call the device that the bench names."""
        await self.line.open(self.bench.link, self.bench.rig, self.bench.out / "runs")
        self.redraw()

    async def disconnect(self) -> None:
        """Let the device go."""
        await self.line.close()
        self.redraw()

    def _listen(self) -> None:
        if not self.is_running:  # the widgets may be gone before this timer is
            return
        for report in self.line.reports():
            for step in self.steps:
                step.hear(report)

    @property
    def current(self) -> Step:
        """The step that is shown."""
        return next(step for step in self.steps if step.NAME == self.bench.step)

    def redraw(self) -> None:
        """Draw the stepper as things stand now."""
        standings = [Standing(s.NAME, s.outcome(), s.missing(), s.NAME == self.bench.step) for s in self.steps]
        self.query_one(Stepper).show(standings, self._key_of("app.next"))

    @on(Step.Done)
    def save(self) -> None:
        """Save the bench and show what is new."""
        self.bench.save(self.folder)
        self.redraw()

    def on_resize(self) -> None:
        """More room shows more of the stepper."""
        self.call_after_refresh(self.redraw)

    @on(Stepper.Chosen)
    def _chosen(self, event: Stepper.Chosen) -> None:
        self.action_go(event.number)

    def action_go(self, number: int) -> None:
        """Show a step, counted from 1."""
        if not 1 <= number <= len(self.steps):
            return
        step = self.steps[number - 1]
        self.bench.step = step.NAME
        self.query_one("#steps", ContentSwitcher).current = step.id
        step.focus()
        try:
            step.enter()
        finally:
            self.save()

    def action_move(self, by: int) -> None:
        """Show the step before or after."""
        self.action_go(self.steps.index(self.current) + 1 + by)

    def action_help(self) -> None:
        """What this step, or the run browser on top of it, is for and which keys work here."""
        shown = self.screen if isinstance(self.screen, RunBrowser) else self.current
        keys = " · ".join(
            f"`{self.get_key_display(active.binding)}` {active.binding.description}"
            for active in self.screen.active_bindings.values()
            if active.binding.description and not active.binding.system
        )
        self.push_screen(HelpScreen(f"# {shown.NAME}\n\n{shown.HELP}\n\nAll keys here: {keys}\n"))

    def action_browse(self) -> None:
        """Look at the runs, and choose those to work on."""
        self.push_screen(RunBrowser(self.bench.out / "runs", self.bench.runs), self._choose_runs)

    def action_next_theme(self) -> None:
        """Dark, light, high contrast."""
        names = [theme.name for theme in THEMES]
        here = names.index(self.theme) if self.theme in names else -1
        self.theme = names[(here + 1) % len(names)]

    def action_leave(self) -> None:
        """Take notices away and go from a field back to the step."""
        self.clear_notifications()
        self.current.focus()

    async def action_quit(self) -> None:
        """Quit; ask first when something would be lost."""
        stakes = [text for step in self.steps if (text := step.at_stake())]
        if not stakes:
            self.exit()
        elif not isinstance(self.screen, Question):
            self.push_screen(Question(f"Quit now and lose {' and '.join(stakes)}?", "Quit", "Stay"), self._quit_if)

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """The steps, in the command palette."""
        yield from super().get_system_commands(screen)
        for number, step in enumerate(self.steps, 1):
            yield SystemCommand(
                f"{number} {step.NAME}", f"Go to step {number}", lambda number=number: self.action_go(number)
            )

    def mishap(self, error: Exception) -> None:
        """Tell the operator what went wrong; what nobody foresaw goes to a log file with its traceback.

        Whatever a handler, an action or a worker of a step raises ends here; the app lives on.
        """
        if isinstance(error, WorkerFailed) and isinstance(error.error, Exception):
            error = error.error
        if isinstance(error, DprError):
            said = str(error)
        else:
            log = self._log_file(error)
            said = f"Unexpected: {type(error).__name__}: {error}. Your work is kept; details are in {log}"
        self.notify(said, title="Error", severity="error", timeout=ERROR_S, markup=False)

    def _handle_exception(self, error: Exception) -> None:
        if self.is_running and self.screen_stack:
            self.mishap(error)
        else:
            super()._handle_exception(error)

    def _log_file(self, error: Exception) -> Path:
        self.folder.mkdir(parents=True, exist_ok=True)
        log = self.folder / "errors.log"
        with log.open("a", encoding="utf-8") as file:
            file.write(f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}\n{''.join(traceback.format_exception(error))}\n")
        return log

    def _quit_if(self, sure: bool | None) -> None:
        if sure:
            self.exit()

    def _choose_runs(self, runs: list[Path] | None) -> None:
        if runs is not None:
            self.bench.runs = runs
            self.current.enter()
            self.save()

    def _keep_theme(self, name: str) -> None:
        self.bench.theme = name
        self.save()

    def _key_of(self, action: str) -> str:
        return next(
            (
                self.get_key_display(active.binding)
                for active in self.screen.active_bindings.values()
                if active.binding.id == action
            ),
            "",
        )
