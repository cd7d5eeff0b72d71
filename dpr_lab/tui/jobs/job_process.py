"""Start and control of a job in a separate process, and reception of its events."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from textual.dom import DOMNode
from textual.message import Message
from textual.worker import Worker

from dpr_lab.child_process import ChildFunction
from dpr_lab.tui.jobs.job_control import work
from dpr_lab.tui.jobs.job_events import JobCancelled, JobCompiling, JobEvent, JobFailed, JobProgress
from dpr_lab.tui.read_only import refuse_job


class JobProcess:
    """Function that runs in a separate process; the constructor starts the process.

    Args:
        function: function importable by name; the process calls `function(control, **arguments)`
        arguments: picklable keyword arguments
    """

    def __init__(self, function: Callable[..., Any], **arguments: Any) -> None:
        self._process = ChildFunction(work, function, arguments)
        self._cancelled = False

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.alive

    def events(self, patience_s: float = 5.0) -> Iterator[JobEvent]:
        """Yield the events of the job until its end.

        The iterator blocks, so use it in a thread.

        Args:
            patience_s: maximum waiting time for the process to exit, s; the process is then terminated
        """
        event: JobEvent = JobProgress(None)
        while isinstance(event, JobProgress | JobCompiling):
            try:
                event = self._process.pipe.recv()
            except (EOFError, OSError):
                self._process.wait(patience_s)
                event = self._gone()
            yield event
        self._process.end(patience_s)

    def stop(self) -> None:
        """End the job early and keep the best result so far."""
        with suppress(OSError):  # the process may just have ended
            self._process.pipe.send("stop")

    def cancel(self) -> None:
        """End the job at once without a result."""
        self._cancelled = True
        self._process.terminate()

    def _gone(self) -> JobEvent:
        if self._cancelled:
            return JobCancelled()
        return JobFailed(
            f"the process of the job ended unexpectedly (exit code {self._process.exit_code}); only its"
            " result was lost. Start the job again; if memory was short, close other programs first"
        )


@dataclass
class JobHeard(Message, bubble=False):
    """Event of a job; it is posted to the widget that started the job."""

    job: JobProcess
    event: JobEvent


class _Reception(Worker[None]):
    """Worker that posts the events of a job to a node; if it is cancelled, so is the job."""

    def __init__(self, owner: DOMNode, job: JobProcess) -> None:
        super().__init__(owner, self._receive, group="job", exit_on_error=False)
        self._job = job

    def cancel(self) -> None:
        """Cancel the worker and the job, also before the first step of the worker."""
        super().cancel()
        self._job.cancel()

    async def _receive(self) -> None:
        try:
            await asyncio.to_thread(self._listen)
        finally:
            self._job.cancel()

    def _listen(self) -> None:
        for event in self._job.events():
            self.node.post_message(JobHeard(self._job, event))


def start_job(owner: DOMNode, function: Callable[..., Any], **arguments: Any) -> JobProcess:
    """Start a `JobProcess`, whose events are posted to `owner` as `JobHeard` messages.

    The job is cancelled when `owner` is removed, and at once if it was removed before.

    Raises:
        SafetyStop: the page is read-only, and the job does more than read.
    """
    refuse_job(getattr(owner.app, "read_only", False), function)
    job = JobProcess(function, **arguments)
    reception = _Reception(owner, job)
    owner.workers.add_worker(reception, exclusive=False)
    if not owner.is_attached:
        reception.cancel()
    return job
