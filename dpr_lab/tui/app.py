"""Textual app of the terminal user interface: list of steps, current step, and active keys."""

import asyncio
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import ClassVar

from rich.console import RenderableType
from textual import events, on
from textual._compositor import CompositorUpdate
from textual.app import ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.dom import DOMNode
from textual.driver import Driver
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import ContentSwitcher, Static
from textual.worker import WorkerFailed

from dpr_lab.errors import DprError, SafetyStop
from dpr_lab.report.angles import UNITS
from dpr_lab.tui import FRAMES_PER_S
from dpr_lab.tui.guard import Guarded, log
from dpr_lab.tui.keys import Keymap, KeyNames, about_keys, actions, bindings
from dpr_lab.tui.notices import FILE, MessageLog, NoticeApp
from dpr_lab.tui.pages import open_page
from dpr_lab.tui.palette import commands
from dpr_lab.tui.read_only import READ_ONLY
from dpr_lab.tui.recorder.connection import DeviceConnection
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.steps.compare import CompareStep
from dpr_lab.tui.steps.connect import ConnectStep
from dpr_lab.tui.steps.diagnose import DiagnoseStep
from dpr_lab.tui.steps.identify import IdentifyStep
from dpr_lab.tui.steps.job_step import JobStep
from dpr_lab.tui.steps.plan import PlanStep
from dpr_lab.tui.steps.rig import RigStep
from dpr_lab.tui.steps.step import Step
from dpr_lab.tui.terminal.display import Display
from dpr_lab.tui.terminal.drivers import our_driver
from dpr_lab.tui.terminal.plain import Plain
from dpr_lab.tui.terminal.sight import Sight
from dpr_lab.tui.terminal.signals import ENDING, end_on_signals
from dpr_lab.tui.texts import ABOUT_TERMS, NOTICES, following
from dpr_lab.tui.themes import THEMES
from dpr_lab.tui.viewed_app import ViewedApp
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.tui.widgets.dialogs import HelpScreen, Question, confirm
from dpr_lab.tui.widgets.key_line import KeyLine
from dpr_lab.tui.widgets.run_browser import RunBrowser
from dpr_lab.tui.widgets.status_line import StatusLine
from dpr_lab.tui.widgets.stepper import Stepper, StepStatus
from dpr_lab.tui.workspace import Workspace

STEPS: tuple[type[Step], ...] = (ConnectStep, RigStep, CaptureStep, IdentifyStep, CompareStep, DiagnoseStep, PlanStep)
"""Steps in the order that defines their numbers and keys."""

LEAST = (80, 24)
"""Minimum size of the window: columns and rows."""

KEYED: tuple[type[DOMNode], ...] = (*STEPS, Chart, RunBrowser)
"""Classes, in addition to the app, whose actions can be assigned other keys."""


class DprApp(Guarded, NoticeApp, ViewedApp):
    """Textual app of `dpr-lab tui`.

    Args:
        workspace: rig, link, folder and results of the operator
        folder: where the workspace is saved and unexpected errors are logged
        keymap: the operator's keys, see `dpr_lab.tui.keys`
        notices: messages at the start
        steps: the steps to show
        sight: confirms that the operator sees the screen; default: the terminal
        allow_release: whether the rods may also be released from a browser
        read_only: whether the screen is read-only: no command to a device, no file written
    """

    TITLE = "dpr-lab"
    VERTICAL_BREAKPOINTS = [(30, "-tall")]  # noqa: RUF012 - Textual declares it as an instance variable
    CSS_PATH = Path(__file__).with_name("app.tcss")
    BINDINGS: ClassVar[list[BindingType]] = [
        *(Binding(f"{n}", f"go({n})", show=False, id=f"app.step_{n}") for n in range(1, len(STEPS) + 1)),
        *bindings("app"),
    ]

    def __init__(
        self,
        workspace: Workspace,
        folder: Path,
        keymap: Keymap | None = None,
        notices: Sequence[str] = (),
        steps: Sequence[type[Step]] = STEPS,
        sight: Sight | None = None,
        allow_release: bool = False,
        read_only: bool = False,
    ) -> None:
        super().__init__()
        self.read_only = read_only
        self._filters.append(Plain())
        self.terminal = Display(lambda: self._driver, self.console._color_system, allow_release)
        self.workspace = workspace
        self.folder = folder
        self.device = DeviceConnection(folder / "recorder.log", read_only=read_only)
        names = KeyNames(actions(DprApp, *KEYED) | (keymap or {}), lambda key: self.get_key_display(Binding(key, "")))
        order = tuple(step.NAME for step in STEPS)
        self.services = Services(workspace, self.device, order, names, sight or self.terminal)
        self._notices = notices
        self._saved = True
        self._had_focus: Widget | None = None
        self.messages, self.error_title = MessageLog(folder / FILE), names.fill(NOTICES.error_title)
        self.steps = [step(self.services) for step in steps]
        for theme in THEMES:
            self.register_theme(theme)
        self.theme = workspace.theme if workspace.theme in self.available_themes else THEMES[0].name
        self.set_keymap(keymap or {})

    def compose(self) -> ComposeResult:
        """Build stepper, status line, current step and key line."""
        yield Stepper(id="stepper")
        yield StatusLine(id="status", markup=False)
        with ContentSwitcher(id="steps"):
            yield from self.steps
        yield Static(id="too-small")
        yield KeyLine()

    def on_mount(self) -> None:
        """Resume at the last step."""
        self.theme_changed_signal.subscribe(self, lambda theme: self._keep_theme(theme.name))
        self.app_resume_signal.subscribe(self, lambda _: self.terminal.forget())
        if not self.is_headless:
            loop = asyncio.get_running_loop()
            end_on_signals(
                lambda: loop.call_soon_threadsafe(self.exit, None, ENDING.exit_code),
                lambda: self._driver.stop_application_mode() if self._driver is not None else None,
            )
        self.set_interval(1 / FRAMES_PER_S, self._listen)
        last = next((i for i, step in enumerate(self.steps, 1) if self.workspace.step == step.NAME), 1)
        self.action_go(last)
        for notice in self._notices:
            self.notify(notice, severity="warning", timeout=NOTICES.error_s)

    async def on_unmount(self) -> None:
        """End all processes."""
        self.terminal.close()
        await self.device.close()

    def _listen(self) -> None:
        if not self.is_running:  # the widgets may be removed before this timer ends
            return
        for report in self.device.reports():
            for step in self.steps:
                step.hear(report)
        urgent = next((step.urgent for step in self.steps if step.urgent), "")
        work = [step.work for step in self.steps if step.work]
        self.query_one(StatusLine).show(self.device, urgent, work, self.workspace.out, time.monotonic())

    def get_driver_class(self) -> type[Driver]:
        """Return the class of the terminal driver.

        If this package has a driver for the terminal, its class is returned. Otherwise the driver of Textual is used.
        """
        return our_driver(super().get_driver_class())

    async def on_event(self, event: events.Event) -> None:
        """Handle an event; the response to a key or click is drawn without delay."""
        if isinstance(event, events.Key | events.MouseDown):
            self.terminal.hurry()
        await super().on_event(event)

    def on_key(self, event: events.Key) -> None:
        """Notify the operator that a key has no function here."""
        if event.is_printable and len(self.screen_stack) == 1 and event.key not in self.screen.active_bindings:
            key, keys = self.get_key_display(Binding(event.key, "")), self.services.keys.key_for("app.help")
            self.notify(f"{key} has no function here; {keys} shows the keys", timeout=NOTICES.hint_s)

    def on_cursor_position(self, event: events.CursorPosition) -> None:
        """Register a reported cursor position, which confirms a frame."""
        self.terminal.confirmed(event.x, event.y)

    def _display(self, screen: Screen[object], renderable: RenderableType | None) -> None:
        if not isinstance(renderable, CompositorUpdate) or self.is_headless or self._batch_count:
            super()._display(screen, renderable)
        elif self._running and not self._closed:
            self.terminal.together = self._sync_available
            self.terminal.show(renderable, self.size)
            self.post_display_hook()

    @property
    def current(self) -> Step:
        """The current step."""
        return next(step for step in self.steps if step.NAME == self.workspace.step)

    def redraw(self) -> None:
        """Redraw the list of steps, the status line and the key line."""
        keys, step = self.services.keys, self.workspace.step
        status = [
            StepStatus(s.NAME, s.outcome(), s.missing(), s.NAME == step, s.stale(), bool(s.work)) for s in self.steps
        ]
        page = self.current.report()
        report = keys.key_for("app.report") if page is not None and page.is_file() else ""
        self.query_one(Stepper).show(status, keys.key_for("app.next"), report)

    @on(Step.Done)
    def save(self) -> None:
        """Save the workspace and redraw.

        A failure to save the workspace is reported only once.
        """
        try:
            if not self.read_only:
                self.workspace.save(self.folder)
            self._saved = True
        except DprError as error:
            if self._saved:
                self.mishap(error)
            self._saved = False
        self.redraw()

    @on(JobStep.JobDone)
    def _tell(self, message: JobStep.JobDone) -> None:
        if self.current is not message.step:
            self.current.enter()
            news = f"{message.step.NAME} is done: {message.step.outcome()}"
            self.notify(news, timeout=NOTICES.news_s)

    def on_resize(self, event: events.Resize) -> None:
        """Adapt the list of steps to the width.

        If the window is too small, a message is shown.
        """
        width, height = event.size
        main = self.screen_stack[0]
        small = width < LEAST[0] or height < LEAST[1]
        if small and not main.has_class("-too-small"):
            self._had_focus = main.focused  # a hidden widget loses the focus
        main.set_class(small, "-too-small")
        need = f"{width}x{height} is too small: the screen needs {LEAST[0]}x{LEAST[1]}. Enlarge the window or"
        self.query_one("#too-small", Static).update(f"{need} choose a smaller font. A recording continues meanwhile.")
        self.call_after_refresh(self._resized)

    def _resized(self) -> None:
        main, had = self.screen_stack[0], self._had_focus
        if not main.has_class("-too-small") and main.focused is None:
            main.set_focus(had if had is not None and had.focusable else self.current)
        self.redraw()

    @on(Stepper.Chosen)
    def _chosen(self, event: Stepper.Chosen) -> None:
        self.action_go(event.number)

    def action_go(self, number: int) -> None:
        """Show a step, numbered from 1."""
        if not 1 <= number <= len(self.steps):
            return
        step = self.steps[number - 1]
        if step.NAME != self.workspace.step:
            self.clear_notifications()  # removes notices about the previous step
        self.workspace.step = step.NAME
        with self.batch_update():  # the step and its keys are drawn in one frame
            self.query_one("#steps", ContentSwitcher).current = step.id
            step.screen.set_focus(step)
            self.query_one(KeyLine).show()
        try:
            step.enter()
        finally:
            self.save()

    def action_move(self, by: int) -> None:
        """Show the previous or next step."""
        self.action_go(self.steps.index(self.current) + 1 + by)

    def action_help(self) -> None:
        """Show purpose and keys of the current step, or of the open run browser."""
        shown = self.screen if isinstance(self.screen, RunBrowser) else self.current
        keys = " · ".join(
            f"`{self.get_key_display(active.binding)}` {active.binding.description}"
            for active in self.screen.active_bindings.values()
            if active.binding.description and not active.binding.system
        )
        text = self.services.keys.fill(shown.HELP or "")
        self.push_screen(
            HelpScreen(f"# {shown.NAME}\n\n{text}\n\nAll keys here: {keys}\n\n{about_keys()}\n\n{ABOUT_TERMS}")
        )

    def action_browse(self) -> None:
        """Open the run browser to select runs."""
        self.push_screen(RunBrowser(self.services, self.workspace.runs), self._choose_runs)

    def action_import_table(self, file: str = "") -> None:
        """Open the import of a recording from a different logger, for the current rig.

        If no file is given, the dialog asks for it.
        """
        from dpr_lab.tui.steps.table_import import TableImport

        self.push_screen(TableImport(self.workspace.rig, self.workspace.out / "runs", file), self._imported)

    def _imported(self, run: Path | None) -> None:
        if run is not None:
            self._choose_runs([*self.workspace.runs, run])
            news = f"imported as {run}, and selected for identification"
            self.notify(news, timeout=NOTICES.news_s)

    def action_next_theme(self) -> None:
        """Switch between dark, light and high contrast."""
        self.theme = following([theme.name for theme in THEMES], self.theme)

    def action_next_unit(self) -> None:
        """Switch between degrees and radians."""
        self.workspace.angles = following(list(UNITS), self.workspace.unit.name)
        self.current.enter()
        self.save()

    def action_leave(self) -> None:
        """Dismiss notices and move the focus from a field to the step."""
        self.clear_notifications()
        self.current.focus()

    async def action_quit(self) -> None:
        """Quit; ask for confirmation if something would be lost."""
        stakes = [text for step in self.steps if (text := step.at_stake())]
        if not stakes:
            self.exit()
        elif not isinstance(self.screen, Question):
            confirm(self, f"Quit now? {' '.join(stakes)}", "Quit", "Stay", self.exit)

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Yield the entries of the command palette: the steps, and every action with its key."""
        yield from super().get_system_commands(screen)
        yield from commands(self, self.steps, self.services.keys, self.action_go)

    def deliver_screenshot(
        self, filename: str | None = None, path: str | None = None, time_format: str | None = None
    ) -> str | None:
        """Save a screenshot in the folder of the results; show its path or the error."""
        if self.read_only:
            self.mishap(SafetyStop(READ_ONLY))
            return None
        folder = Path(path) if path else self.workspace.out / "screenshots"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            saved = self.save_screenshot(filename, str(folder), time_format)
        except OSError as error:
            self.mishap(DprError(f"{folder}: the screenshot cannot be saved: {error.strerror or error}"))
            return None
        self.notify(f"saved: {saved}")
        return saved

    def action_report(self) -> None:
        """Open the report of the step."""
        page = self.current.report()
        if page is None or not page.is_file():
            raise DprError("This step has no report yet: the steps Compare and Diagnose write reports")
        open_page(self, page)

    def mishap(self, error: Exception) -> None:
        """Show an error; an unexpected error is also logged with its traceback.

        All exceptions of handlers, actions and workers of a step are passed to this method, so that the app continues.
        """
        if isinstance(error, WorkerFailed) and isinstance(error.error, Exception):
            error = error.error
        if isinstance(error, DprError):
            text = self.services.keys.fill(str(error))
        else:
            text = f"Unexpected: {type(error).__name__}: {error}. Your work is kept; {log(error, self.folder)}"
        self.notify(text, severity="error")

    def _handle_exception(self, error: Exception) -> None:
        if self.is_running and self.screen_stack:
            self.mishap(error)
        else:
            super()._handle_exception(error)

    def _choose_runs(self, runs: list[Path] | None) -> None:
        if runs is not None:
            self.workspace.runs = runs
            self.current.enter()
            self.save()

    def _keep_theme(self, name: str) -> None:
        self.workspace.theme = name
        self.save()
