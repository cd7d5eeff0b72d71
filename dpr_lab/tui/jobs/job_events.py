"""What a job tells the screen: progress, and in the end how it ended."""

from dataclasses import dataclass
from typing import Any, TypeAlias

from dpr_lab.errors import DprError


@dataclass(frozen=True, slots=True)
class JobProgress:
    """A progress event of a job."""

    value: Any


@dataclass(frozen=True, slots=True)
class JobCompiling:
    """The work waits for a kernel, or a further one, to be compiled."""


@dataclass(frozen=True, slots=True)
class JobFinished:
    """The work is done."""

    result: Any


@dataclass(frozen=True, slots=True)
class JobFailed:
    """The work ended without a result."""

    message: str
    """What happened and what to do."""
    details: str = ""
    """Traceback of what should not have happened; empty for an error that the operator can act on."""

    @property
    def error(self) -> Exception:
        """The same as an exception, with the traceback as a note."""
        if not self.details:
            return DprError(self.message)
        error = RuntimeError(self.message)
        error.add_note(self.details)
        return error


@dataclass(frozen=True, slots=True)
class JobCancelled:
    """The work was ended on request; nothing of it is kept."""


JobEvent: TypeAlias = JobProgress | JobCompiling | JobFinished | JobFailed | JobCancelled
