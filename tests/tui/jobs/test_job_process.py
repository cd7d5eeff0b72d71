"""Jobs in separate processes: reports, stopping, cancelling, and every kind of end."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from multiprocessing import Pipe
from typing import Any

import pytest
from textual.app import App
from textual.pilot import Pilot
from textual.widgets import Static

from dpr_lab.errors import RunError
from dpr_lab.progress import compiling
from dpr_lab.tui.jobs import job_process
from dpr_lab.tui.jobs.job_control import JobControl
from dpr_lab.tui.jobs.job_events import JobCancelled, JobCompiling, JobEvent, JobFailed, JobFinished, JobProgress
from dpr_lab.tui.jobs.job_process import JobProcess, start_job


def count(control: JobControl, to: int) -> int:
    for number in range(to):
        if not control.proceed():
            return number
        control.report(number)
    return to


def count_forever(control: JobControl) -> int:
    number = 0
    while control.proceed():
        control.report(number)
        number += 1
        time.sleep(0.001)
    return number


def fail(control: JobControl, kind: str) -> None:
    raise RunError("no such run: choose another") if kind == "told" else ZeroDivisionError("by zero")


def tell_pid(control: JobControl) -> None:
    control.report(os.getpid())
    while control.proceed():
        time.sleep(0.01)


def compile_one(control: JobControl) -> str:
    compiling()
    return "compiled"


def chatter(control: JobControl) -> str:
    os.write(1, b"noise on stdout")
    os.write(2, b"noise on stderr")
    return "quiet"


@pytest.fixture
def begin() -> Iterator[Callable[..., JobProcess]]:
    jobs: list[JobProcess] = []

    def made(function: Callable[..., Any], **arguments: Any) -> JobProcess:
        jobs.append(JobProcess(function, **arguments))
        return jobs[-1]

    yield made
    for job in jobs:
        job.cancel()
        for _ in job.events():
            pass


def numbers(events: list[JobEvent]) -> list[int]:
    return [event.value for event in events if isinstance(event, JobProgress)]


def test_progress_comes_in_order_and_the_result_last(begin) -> None:
    *reported, last = begin(count, to=5).events()
    assert numbers(reported) == [0, 1, 2, 3, 4]
    assert last == JobFinished(5)


def test_work_that_waits_for_the_compiler_reports_it(begin) -> None:
    assert list(begin(compile_one).events()) == [JobCompiling(), JobFinished("compiled")]


def test_stopping_keeps_the_best_result_so_far(begin) -> None:
    job = begin(count_forever)
    events = job.events()
    next(events)
    job.stop()
    *_, last = events
    assert isinstance(last, JobFinished)
    assert last.result > 0


def test_cancelled_work_leaves_no_result(begin) -> None:
    job = begin(count_forever)
    events = job.events()
    next(events)
    job.cancel()
    *_, last = events
    assert last == JobCancelled()
    assert not job.alive


def test_an_error_for_the_operator_arrives_with_its_message(begin) -> None:
    assert list(begin(fail, kind="told").events()) == [JobFailed("no such run: choose another")]


def test_an_unexpected_exception_arrives_with_its_traceback(begin) -> None:
    (failed,) = begin(fail, kind="bug").events()
    assert isinstance(failed, JobFailed)
    assert failed.message == "ZeroDivisionError: by zero"
    assert "in fail" in failed.details


def test_a_killed_process_is_reported_as_killed(begin) -> None:
    events = begin(tell_pid).events()
    os.kill(next(events).value, signal.SIGKILL)
    (last,) = events
    assert isinstance(last, JobFailed)
    assert "exit code -9" in last.message


def test_work_ends_when_its_parent_process_has_ended(begin) -> None:
    job = begin(tell_pid)
    next(job.events())
    job._process.pipe.close()
    job._process.wait(60)
    assert not job.alive


def test_work_never_writes_on_the_screen(begin, capfd: pytest.CaptureFixture[str]) -> None:
    assert list(begin(chatter).events()) == [JobFinished("quiet")]
    assert capfd.readouterr() == ("", "")


class Connected:
    """Process that only keeps its pipe open until it is terminated; a real one starts in seconds on a busy machine."""

    exit_code = -15

    def __init__(self, *_: Any) -> None:
        self.pipe, self._theirs = Pipe()
        self.alive = True

    def terminate(self) -> None:
        self.alive = False
        self._theirs.close()

    def wait(self, patience_s: float) -> None:
        pass

    def end(self, patience_s: float) -> None:
        self.pipe.close()


async def removed_later(pilot: Pilot[None], owner: Static) -> JobProcess:
    job = start_job(owner, tell_pid)
    await pilot.pause()
    assert job.alive
    await owner.remove()
    return job


async def removed_at_once(pilot: Pilot[None], owner: Static) -> JobProcess:
    job = start_job(owner, tell_pid)
    await owner.remove()
    return job


async def ended_before_the_first_step(pilot: Pilot[None], owner: Static) -> JobProcess:
    job = start_job(owner, tell_pid)
    pilot.app.workers.cancel_node(owner)
    return job


async def removed_before(pilot: Pilot[None], owner: Static) -> JobProcess:
    await owner.remove()
    return start_job(owner, tell_pid)


@pytest.mark.parametrize("end", [removed_later, removed_at_once, ended_before_the_first_step, removed_before])
async def test_no_job_outlives_its_widget(monkeypatch: pytest.MonkeyPatch, end) -> None:
    monkeypatch.setattr(job_process, "ChildFunction", Connected)
    async with App[None]().run_test() as pilot:
        owner = Static()
        await pilot.app.mount(owner)
        job = await end(pilot, owner)
        await pilot.pause()
        alive = job.alive
        job.cancel()
        assert not alive
