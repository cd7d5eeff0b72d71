"""A step whose work runs in a process of its own: starting it, hearing from it, and the keys that steer it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from textual import on
from textual.binding import Binding
from textual.message import Message
from textual.widgets import Input, TabbedContent, TabPane

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.tui.step import Step
from dpr_lab.tui.work import Cancelled, Event, Failed, Finished, Job, Progress

NOTICE_S = 20.0
NO_RUNS = "No runs selected: record some in step 3, or choose recorded ones (b)"
MOST_SEED = 2**32 - 1


def work_keys(place: str) -> list[Binding]:
    """The keys that steer a step's work, as actions of that place."""
    return [
        Binding("s", "start", "Start", id=f"{place}.start"),
        Binding("space", "pause", "Pause/go on", id=f"{place}.pause"),
        Binding("x", "stop", "Stop, keep best", id=f"{place}.stop"),
        Binding("c", "cancel", "Cancel", id=f"{place}.cancel"),
    ]


class WorkingStep(Step):
    """A step with at most one job at work; what it reports arrives as calls of the four methods below."""

    WORK: ClassVar[str]
    """What runs, as an object of `lose`: `the identification`."""
    CAN_PAUSE: ClassVar[bool] = False
    """Whether its work asks `Control.proceed`."""

    DEFAULT_CSS = """
    WorkingStep Select:focus SelectCurrent { text-style: reverse; }
    WorkingStep VerticalScroll { border-left: blank; }
    WorkingStep VerticalScroll:focus { border-left: outer $primary; }
    """

    @dataclass
    class Heard(Message):
        """Something that a job told."""

        job: Job
        event: Event

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self.job: Job | None = None

    def start_work(self) -> None:
        """Begin what the form says; called when nothing is missing and nothing runs."""

    def progressed(self, value: Any) -> None:
        """The job reported something."""

    def finished(self, result: Any) -> None:
        """The job is done."""

    def ended(self, why: str) -> None:
        """The job ended without a result; why has been told already where it is an error."""

    def at_stake(self) -> str:
        """The work that runs."""
        return self.WORK if self.job is not None else ""

    def begin(self, function: Callable[..., Any], **arguments: Any) -> None:
        """Start a job in the place of the one that may run."""
        self.abandon()
        self.job = Job(function, **arguments)
        self.run_worker(partial(self._listen, self.job), thread=True, exit_on_error=False, group="job")
        self.refresh_bindings()

    def abandon(self) -> None:
        """End the job that runs, if any; nothing more is heard of it."""
        if self.job is not None:
            self.job.cancel()
            self.job = None
            self.refresh_bindings()

    def on_unmount(self) -> None:
        """Nobody is left to work for."""
        if self.job is not None:
            self.job.cancel()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show the keys that do something now."""
        working = self.job is not None
        pausing = working and self.CAN_PAUSE
        return {"start": not working, "pause": pausing, "stop": pausing, "cancel": working}.get(action, True)

    def action_start(self) -> None:
        """Begin, or say what must come first."""
        if missing := self.missing():
            raise DprError(missing)
        self.start_work()

    def action_pause(self) -> None:
        """Pause, or go on."""
        if self.job is not None:
            self.job.resume() if self.job.paused else self.job.pause()

    def action_stop(self) -> None:
        """End early, keep the best so far."""
        if self.job is not None:
            self.job.stop()

    def action_cancel(self) -> None:
        """End at once, keep nothing."""
        if self.job is not None:
            self.job.cancel()

    def whole_number(self, name: str, least: int, most: int) -> int:
        """What stands in the field of that name.

        Raises:
            ConfigError: no such number.
        """
        text = self.query_one(f"#{name}", Input).value
        if not text.isdecimal() or not least <= int(text) <= most:
            raise ConfigError(f"{name} = {text!r}: write a whole number from {least} to {most}")
        return int(text)

    def show_next_tab(self) -> None:
        """Go to the next of the step's tabs."""
        tabs = self.query_one(TabbedContent)
        names = [pane.id or "" for pane in tabs.query(TabPane)]
        tabs.active = names[(names.index(tabs.active) + 1) % len(names)]
        self.query_one(f"#{tabs.active}").query("VerticalScroll, Chart").first().focus()

    def _listen(self, job: Job) -> None:
        for event in job.events():
            self.post_message(self.Heard(job, event))

    @on(Heard)
    def _obey(self, message: Heard) -> None:
        message.stop()
        if message.job is not self.job:
            return
        if isinstance(message.event, Progress):
            self.progressed(message.event.value)
            return
        self.job = None
        self.refresh_bindings()
        match message.event:
            case Finished(result):
                self.finished(result)
                self._tell_elsewhere()
            case Failed(said) as failed:
                self.ended(said)
                self.lab.mishap(failed.error)
            case Cancelled():
                self.ended("cancelled")

    def _tell_elsewhere(self) -> None:
        """Another step is shown: it may need what is new, and the operator has not seen it."""
        if (shown := self.lab.current) is not self:
            shown.enter()
            self.lab.notify(f"{self.NAME} is done: {self.outcome()}", timeout=NOTICE_S, markup=False)
