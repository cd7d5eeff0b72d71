"""A step with a job in a separate process.

The module contains the start of the job, the handling of its events, and the keys that control it.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from textual import on
from textual.message import Message
from textual.widgets import Input, TabbedContent, TabPane

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.kernel_cache import COMPILING
from dpr_lab.tui.jobs.job_events import JobCancelled, JobCompiling, JobFailed, JobFinished, JobProgress
from dpr_lab.tui.jobs.job_process import JobHeard, JobProcess, start_job
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps.step import Step
from dpr_lab.tui.texts import following

READING = "reading the runs"


class JobStep(Step):
    """Step with at most one running job.

    The events of the job call `compiling`, `progressed`, `finished` and `ended`.
    """

    PURPOSE: ClassVar[str]
    """Purpose of the job, shown after the key that starts the job."""
    RESTS_ON: ClassVar[tuple[str, ...]] = ()
    """Inputs on which the result depends: keys of `Workspace.basis`."""

    TYPICAL_S: ClassVar[float] = 0.0
    """Typical duration of the first job of a workspace, s for each run; 0 if it is unknown."""
    CAN_STOP: ClassVar[bool] = False
    """Whether the job can be stopped (`JobControl.proceed`)."""

    DEFAULT_CSS = """
    JobStep Select:focus SelectCurrent { text-style: reverse; }
    JobStep VerticalScroll { border-left: blank; }
    JobStep VerticalScroll:focus { border-left: outer $primary; }
    """

    @dataclass
    class JobDone(Message):
        """Event: a job finished with a result."""

        step: "JobStep"

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self.job: JobProcess | None = None
        self._started = 0.0
        self._kernels = 0
        self._compiling: float | None = None
        self._compiled_s = 0.0
        self._basis: dict[str, str] = {}

    def stale(self) -> str:
        """Return a sentence that names the inputs which changed after the result was computed.

        The text is empty if no input changed.
        """
        used, now = self.workspace.made_from.get(self.NAME, {}), self.workspace.basis()
        changed = [kind for kind in self.RESTS_ON if used.get(kind, now[kind]) != now[kind]]
        if not changed or not self.outcome() or self.job is not None:
            return ""
        return self.worded(f"STALE, {' and '.join(changed)} changed; {{{self.NAME.lower()}.start}}: run again")

    @property
    def work(self) -> str:
        """Running job with its elapsed and remaining time, or an empty text without a job."""
        if self.job is None:
            return ""
        now = time.monotonic()
        text = f"{self.NAME} {now - self._started:.0f} s"
        if self._compiling is not None:
            return f"{text}, compiling"
        duration_s = self.workspace.took.get(self.NAME, self.TYPICAL_S) * self._runs
        left = self._started + self._compiled_s + duration_s - now
        return f"{text}, about {left:.0f} s left" if left > 0 else text

    def store_inputs(self) -> None:
        """Store the inputs of the new result, and the duration of the job without compilation."""
        self.workspace.made_from[self.NAME] = self._basis
        self.workspace.took[self.NAME] = (time.monotonic() - self._started - self._compiled_s) / self._runs

    @property
    def _runs(self) -> int:
        return max(len(self.workspace.runs), 1)

    def missing(self) -> str:
        """Return a message if no runs are selected; otherwise an empty text."""
        step = self.services.key_of("Capture")
        no_runs = self.worded(f"No runs selected: record some in step {step}, or choose recorded ones ({{app.browse}})")
        return "" if self.workspace.runs else no_runs

    def say(self, text: str) -> None:
        """Show a sentence."""
        self.put("state", text)

    def invite(self) -> None:
        """Describe the job, if there is neither a result nor a running job."""
        if self.job is None and not self.outcome() and not self.missing():
            self.say(self.worded(f"{{{self.NAME.lower()}.start}}: {self.PURPOSE}"))

    def start_work(self) -> None:
        """Read the form and start the job; called only if no input is missing."""

    def compiling(self, now: float) -> None:
        """Show that the job waits for the compilation of a kernel."""
        self._kernels += 1
        self._compiling = self._compiling or now
        self.say(f"{COMPILING} (kernel {self._kernels})")

    def progressed(self, value: Any) -> None:
        """Show a progress event of the job."""

    def finished(self, result: Any) -> None:
        """Show the result of a completed job."""

    def ended(self, why: str) -> None:
        """Show that the job ended without a result.

        Its error has already been shown.
        """

    def begin(self, function: Callable[..., Any], **arguments: Any) -> None:
        """Start a job; further events of a previous job are ignored."""
        self._stop_job()
        self._started, self._basis = time.monotonic(), self.workspace.basis()
        self._kernels, self._compiling, self._compiled_s = 0, None, 0.0
        self.job = start_job(self, function, **arguments)
        if self.display:
            self.focus()  # The focused widget may be in a hidden tab; then no key would control the job.
        self.refresh_bindings()
        self.changed()

    def take_keys(self) -> None:
        """Focus the step if the focused widget has disappeared, so that its keys remain active."""
        if self.display and (self.app.focused is None or not self.app.focused.is_on_screen):
            self.focus()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return whether an action has an effect now; the keys of other actions are hidden."""
        working = self.job is not None
        shown = {
            "start": not working,
            "stop": working and self.CAN_STOP,
            "cancel": working,
            "torque": self.workspace.both_torques,
        }
        return shown.get(action, True)

    def action_torque(self) -> None:
        """Select measured or commanded torques for all steps."""
        self.workspace.torque = "" if self.workspace.torque else "commanded"
        chosen = f"selected: {self.workspace.torque or 'measured'} torques for runs that contain both kinds"
        self.say(self.worded(f"{chosen}; {{{self.NAME.lower()}.start}}: run again"))
        self.changed()

    def action_start(self) -> None:
        """Start the job, or report what is missing."""
        if missing := self.missing():
            raise DprError(missing)
        self.start_work()

    def action_stop(self) -> None:
        """End the job early and keep the best result so far."""
        if self.job is not None:
            self.job.stop()

    def action_cancel(self) -> None:
        """End the job at once without a result."""
        if self.job is not None:
            self.say("cancelling")
            self._stop_job()

    def _stop_job(self) -> None:
        if self.job is not None:
            self.job.cancel()

    def whole_number(self, name: str, least: int = 0, most: int = 2**32 - 1) -> int:
        """Return the integer from a form field.

        By default, the range is that of a 32-bit seed.

        Raises:
            ConfigError: the text is not such a number.
        """
        text = self.query_one(f"#{name}", Input).value
        if not text.isdecimal() or not least <= int(text) <= most:
            raise ConfigError(f"{name} = {text!r}: enter an integer from {least} to {most}")
        return int(text)

    def action_view(self) -> None:
        """Show the next tab."""
        tabs = self.query_one(TabbedContent)
        tabs.active = following([pane.id or "" for pane in tabs.query(TabPane)], tabs.active)
        shown = (
            widget for widget in tabs.query_one(f"#{tabs.active}").query("VerticalScroll, Chart") if widget.display
        )
        next(shown, self).focus()

    @on(Input.Submitted)
    def _given(self) -> None:
        self.focus()

    @on(JobHeard)
    def _job_heard(self, message: JobHeard) -> None:
        if message.job is not self.job:
            return
        if isinstance(message.event, JobCompiling):
            self.compiling(time.monotonic())
            return
        if self._compiling is not None:
            self._compiled_s, self._compiling = self._compiled_s + time.monotonic() - self._compiling, None
        if isinstance(message.event, JobProgress):
            self.progressed(message.event.value)
            return
        self.job = None
        self.refresh_bindings()
        self.changed()
        match message.event:
            case JobFinished(result):
                self.store_inputs()
                self.post_message(self.JobDone(self))
                self.finished(result)
                self.call_after_refresh(self.take_keys)
            case JobFailed() as failed:
                self.ended(failed.message)
                raise failed.error
            case JobCancelled():
                self.ended("cancelled")
