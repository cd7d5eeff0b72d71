"""A step whose job has one result, which stays visible until a new job replaces it."""

from pathlib import Path
from typing import ClassVar, Generic, TypeVar

from dpr_lab.report.angles import AngleUnit
from dpr_lab.tui.services import Services
from dpr_lab.tui.steps.job_step import JobStep

Result = TypeVar("Result")


class ResultStep(JobStep, Generic[Result]):
    """Step that shows the result of its job, or the previous result if a job ends without one."""

    RESULT: ClassVar[str]
    """Name of the result, for example `diagnosis`."""

    def __init__(self, services: Services) -> None:
        super().__init__(services)
        self.result: Result | None = None
        self._file: Path | None = None
        """File of the result; None if it was not read from or written to the workspace."""
        self._unit: AngleUnit | None = None

    def draw(self, result: Result, /) -> str:
        """Draw the details of a result in the current unit of angles; return a sentence on the result."""
        raise NotImplementedError

    def show(self, result: Result) -> None:
        """Show a result: its sentence and its details."""
        self.result, self._unit = result, self.workspace.unit
        self.say(self.draw(result))

    def enter(self) -> None:
        """Show the result in the current unit of angles, or describe the job."""
        if self.job is None and self.result is not None and self._unit is not self.workspace.unit:
            self.show(self.result)
        self.invite()

    def ended(self, why: str) -> None:
        """State why there is no new result; the previous result and its sentence remain."""
        self._unit = self.workspace.unit
        previous = "" if self.result is None else f"; the previous one is shown. {self.draw(self.result)}"
        self.say(f"Ended without a {'new ' if previous else ''}{self.RESULT}: {why}{previous}")

    def at_stake(self) -> str:
        """Return a warning that quitting ends the job, or an empty text."""
        return f"The current {self.RESULT} ends without a result." if self.job is not None else ""

    def of_other_runs(self, used: set[str], selected: set[str]) -> str:
        """Return a note if the result does not belong to the selected runs, or an empty text."""
        note = f" This {self.RESULT} used other runs than those selected."
        return "" if used == selected or not selected else note
