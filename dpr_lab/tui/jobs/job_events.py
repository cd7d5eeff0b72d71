"""Events that a job process sends to the screen: progress and end."""

from dataclasses import dataclass
from typing import Any, TypeAlias

from dpr_lab.errors import DprError


@dataclass(frozen=True, slots=True)
class JobProgress:
    """A progress event of a job."""

    value: Any
    """Event of the workflow."""


@dataclass(frozen=True, slots=True)
class JobCompiling:
    """The job waits for the compilation of a kernel."""


@dataclass(frozen=True, slots=True)
class JobFinished:
    """The job has finished."""

    result: Any


@dataclass(frozen=True, slots=True)
class JobFailed:
    """The job ended without a result."""

    message: str
    """What happened and what to do."""
    details: str = ""
    """Traceback of an unexpected error; empty for an error that the operator can resolve."""

    @property
    def error(self) -> Exception:
        """The failure as an exception, with the traceback as a note."""
        if not self.details:
            return DprError(self.message)
        error = RuntimeError(self.message)
        error.add_note(self.details)
        return error


@dataclass(frozen=True, slots=True)
class JobCancelled:
    """The job was cancelled; its result is discarded."""


JobEvent: TypeAlias = JobProgress | JobCompiling | JobFinished | JobFailed | JobCancelled
