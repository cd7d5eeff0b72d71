"""Second curve in Compare: a second run, or the selected run with a second model."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.content import Content
from textual.message import Message
from textual.widgets import Input, Select

from dpr_lab.tui.guard import Guarded
from dpr_lab.tui.jobs import jobs
from dpr_lab.tui.jobs.job_events import JobFailed, JobFinished, JobProgress
from dpr_lab.tui.jobs.job_process import JobHeard, JobProcess, start_job
from dpr_lab.tui.path_suggester import PathSuggester
from dpr_lab.tui.services import Services
from dpr_lab.tui.texts import following
from dpr_lab.workflows.compare import CompareRequest
from dpr_lab.workflows.events import RunCompared

if TYPE_CHECKING:
    from dpr_lab.identification.compare import Comparison

NOTHING, OTHER_MODEL = -1, -2
"""Numbers of the choices "none" and "second model". The runs have the numbers from 0."""


class SecondCurve(Guarded, Horizontal):
    """List of possible second curves, and a field for the file of a second model.

    Args:
        services: services with the workspace of the runs
    """

    DEFAULT_CSS = """
    SecondCurve { height: 1; }
    SecondCurve Select { width: 2fr; margin-right: 1; }
    SecondCurve Input { width: 1fr; }
    """

    @dataclass
    class Offered(Message):
        """Event: the second curve has changed, or the simulation with a second model has started."""

        news: str = ""

    def __init__(self, services: Services) -> None:
        super().__init__()
        self._services = services
        self._runs: Sequence[Comparison] = ()
        self._names: Sequence[str] = ()
        self._shown = 0
        self._model: dict[str, Comparison] = {}
        self._job: JobProcess | None = None
        self._offered: list[tuple[Content, int]] = []

    def compose(self) -> ComposeResult:
        """Build the list of curves and the input field for a second model."""
        yield Select([("second curve: none", NOTHING)], value=NOTHING, allow_blank=False, id="second", compact=True)
        hint = self._services.keys.fill("another model ({compare.edit})")
        yield Input(placeholder=hint, id="other", suggester=PathSuggester(".json"), compact=True)

    def offer(self, runs: "Sequence[Comparison]", names: Sequence[str], shown: int) -> None:
        """Offer the given runs except the displayed one."""
        self._runs, self._names, self._shown = runs, names, shown
        options = [(Content("second curve: none"), NOTHING)]
        options += [(Content(f"second curve: {name}"), i) for i, name in enumerate(names) if i != shown]
        if self._model:
            options.append((Content(f"second curve: the model {Path(self._field.value).name}"), OTHER_MODEL))
        if options != self._offered:
            picker, self._offered = self.query_one(Select), options
            current = picker.value
            picker.set_options(options)
            picker.value = current if any(current == value for _, value in options) else NOTHING

    @property
    def chosen(self) -> "Comparison | None":
        """Comparison for the second curve: a second run, or the selected run with the second model.

        The value is None if no second curve is chosen.
        """
        number = self.query_one(Select).value
        if number == OTHER_MODEL and self._shown < len(self._runs):
            return self._model.get(self._runs[self._shown].run)
        return self._runs[number] if isinstance(number, int) and 0 <= number < len(self._runs) else None

    def cycle(self) -> None:
        """Select the next second curve."""
        picker = self.query_one(Select)
        picker.value = following([value for _, value in self._offered] or [NOTHING], picker.value)

    def edit(self) -> None:
        """Focus the field."""
        self._field.focus()

    @property
    def _field(self) -> Input:
        return self.query_one(Input)

    @on(Select.Changed)
    def _picked(self, event: Select.Changed) -> None:
        event.stop()
        self.post_message(self.Offered())

    @on(Input.Submitted)
    def _named(self, event: Input.Submitted) -> None:
        """Simulate the runs with the second model; if its field is empty, remove this model."""
        self._end()
        self._model = {}
        if name := event.value.strip():
            model = Path(name).expanduser()
            runs, torque = tuple(self._services.workspace.runs), self._services.workspace.driven_by
            request = CompareRequest(runs, model, None, leave_out=True, torque=torque)
            self._job = start_job(self, jobs.compare, request=request)
            self.post_message(self.Offered(f"simulating with {model}"))

    @on(JobHeard)
    def _heard(self, message: JobHeard) -> None:
        from dpr_lab.identification.compare import Comparison

        if message.job is not self._job:
            return
        match message.event:
            case JobProgress(RunCompared(Comparison() as comparison)):
                self._model[comparison.run] = comparison
            case JobFinished():
                self._job = None
                self.offer(self._runs, self._names, self._shown)
                self.query_one(Select).value = OTHER_MODEL
            case JobFailed() as failed:
                self._job = None
                raise failed.error

    def _end(self) -> None:
        if self._job is not None:
            self._job.cancel()
            self._job = None
