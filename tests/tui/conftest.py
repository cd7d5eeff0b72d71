"""Fixtures of the screen: runs on disk, simulated key presses, and snapshots for comparison."""

import asyncio
import inspect
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, redirect_stderr
from multiprocessing import forkserver, get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from textual import screen
from textual.app import App
from textual.pilot import Pilot

from dpr_lab import child_process
from dpr_lab.identification.identify import identify
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.storage.layout import RELEASED
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.writer import RunWriter
from dpr_lab.tui import FRAMES_PER_S
from dpr_lab.tui.app import STEPS, DprApp
from dpr_lab.tui.steps.step import Step
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.tui.widgets.countdown import Countdown
from dpr_lab.tui.workspace import Workspace
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from tests.warm_process import started

DATA = Path(__file__).parent / "data"
SNAPSHOTS = Path(__file__).parent / "snapshots"
PATIENCE_S = 300.0
DRAWN_S = 60.0
"""Time limit until the last chart is drawn on a busy machine, s."""

Lab = Callable[..., AbstractAsyncContextManager[Pilot[None]]]
Until = Callable[[Pilot[None], Callable[[], object]], Awaitable[None]]
Snapshot = Callable[[Pilot[None], str], Awaitable[None]]


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a coroutine test in a separate event loop."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    parameters = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in parameters}))
    return True


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Separate state and key files for each test."""
    monkeypatch.setenv("TZ", "UTC")  # pictures hold local times
    time.tzset()
    monkeypatch.setenv("DPR_LAB_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("DPR_LAB_CONFIG", str(tmp_path / "config"))


@pytest.fixture(scope="session", autouse=True)
def loaded_processes() -> Iterator[None]:
    """Recorders and jobs are forked from a process with the libraries loaded: only their start is another."""
    context, spawned = get_context("forkserver"), child_process.spawn_context
    context.set_forkserver_preload(["tests.loaded", "dpr_lab.tui.recorder.process", "dpr_lab.tui.jobs.jobs"])

    def loaded() -> Any:
        spawned()  # starts the tracker that both ways of starting need
        with redirect_stderr(sys.__stderr__):
            forkserver.ensure_running()
        return context

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child_process, "spawn_context", loaded)
        yield


@pytest.fixture(scope="session", autouse=True)
def patient_pilots() -> Iterator[None]:
    """On a loaded machine a process that the screen starts may need longer than a Pilot waits, half a minute."""
    wait = Pilot._wait_for_screen

    async def waited(pilot: Pilot[None], timeout: float = PATIENCE_S) -> bool:
        return await wait(pilot, timeout)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Pilot, "_wait_for_screen", waited)
        yield


@pytest.fixture(scope="session", autouse=True)
def few_frames() -> Iterator[None]:
    """Redraw as rarely as the program, and not as often as Textual's default. Another Textual may only be slower."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(screen, "UPDATE_PERIOD", 1 / FRAMES_PER_S, raising=False)
        yield


@pytest.fixture(scope="session")
def recorded(paper: Rig, made_once: Callable[[str, Callable[[Path], None]], Path]) -> list[Path]:
    """Run files of three short releases, with the counts that the simulated device would send."""

    def swings(folder: Path) -> None:
        for run in record(load_plant("paper", 3), paper, 3.0):
            written(run, paper, folder)

    return sorted(made_once("recorded", swings).glob("*.mcap"))


def written(run: Run, rig: Rig, folder: Path) -> Path:
    assert run.counts is not None
    path = folder / f"20261121T101500Z_{run.name}.mcap"
    ticks = np.rint((run.t - run.t[0]) * run.rate_hz).astype(np.int64)
    with RunWriter(path, RunMetadata(rig, run.pose, run.rate_hz)) as writer:
        writer.samples(ticks, run.counts)
        writer.event(0, RELEASED, len(run.rest))
        writer.finish(RunSummary(len(run.rest), lost=run.lost, gate="ok"))
    return path


@pytest.fixture(scope="session")
def modelled(recorded: list[Path], paper: Rig, made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """Model of these releases, as written by the command line."""

    def model(folder: Path) -> None:
        identify([load_run(run, rig=paper) for run in recorded], paper).save(folder / "model.json")

    return made_once("modelled", model) / "model.json"


@pytest.fixture
def fixed_model() -> Path:
    """A model that is the same in every test run."""
    return DATA / "model.json"


@pytest.fixture
def fixed_diagnosis() -> Path:
    """Fixed diagnosis of a rig with two effects."""
    return DATA / "diagnosis.json"


class Watched:
    """Confirmation of frames for a screen without a terminal."""

    multiplexer = ""

    async def seen(self, patience_s: float) -> float:
        return 0.0


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    """Fixture (step, ..., size=, other options) that returns the app with these steps and a pilot."""

    @asynccontextmanager
    async def started(*steps: type[Step], size: tuple[int, int] = (80, 24), **bench: Any) -> AsyncIterator[Pilot[None]]:
        bench.setdefault("out", tmp_path / "bench")
        app = DprApp(Workspace(**bench), tmp_path / "state", steps=steps, sight=Watched())
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            yield pilot

    return started


@pytest.fixture
def app(tmp_path: Path) -> Iterator[DprApp]:
    """App with steps 1 to 3 and a new workspace. The test fails if an unexpected error is logged."""
    yield DprApp(Workspace(out=tmp_path / "bench"), tmp_path / "state", steps=STEPS[:3], sight=Watched())
    log = tmp_path / "state" / "errors.log"
    assert not log.exists(), log.read_text()


@pytest.fixture
def notices_text() -> Callable[[DprApp], str]:
    """Fixture (app) that returns all visible notices as one text."""
    return lambda app: "\n".join(notice.message for notice in app.notices)


@pytest.fixture
def quick_countdown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three short seconds before a release."""
    monkeypatch.setattr(Countdown, "SECOND_S", 0.05)


@pytest.fixture
def rig(simulated: Callable[..., Any]) -> Callable[..., str]:
    """Fixture (fault=, ...) that returns the URL of a device in real time, run in this process."""
    return lambda **options: simulated(**{"clock": "realtime", **options}).url


class Cable:
    """Simulated device at a serial port that keeps its name when it is unplugged and plugged in again."""

    def __init__(self, folder: Path, *options: str) -> None:
        self._link, self._options = folder / "ttyRIG", options
        self.url = f"serial://{self._link}?baud=921600"
        self.plug()

    def plug(self) -> None:
        """Plug the cable in."""
        self._device = started("sim_device", ["--seed", "1", *self._options], stdout=subprocess.PIPE)
        assert self._device.stdout is not None
        url = json.loads(self._device.stdout.readline())["url"]
        self._link.unlink(missing_ok=True)
        self._link.symlink_to(url.removeprefix("serial://").partition("?")[0])

    def pull(self) -> None:
        """Unplug the cable."""
        self._device.kill()
        self._device.wait()
        assert self._device.stdout is not None
        self._device.stdout.close()


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Callable[..., Cable]]:
    """(option, ...) -> a device on a cable."""
    made: list[Cable] = []

    def make(*options: str) -> Cable:
        made.append(Cable(tmp_path, *options))
        return made[-1]

    yield make
    for each in made:
        each.pull()


@pytest.fixture
def until() -> Until:
    """Fixture (pilot, condition) that waits until the condition holds, and fails only after minutes."""

    async def waited(pilot: Pilot[None], condition: Callable[[], object]) -> None:
        start_s = time.monotonic()
        while not condition():
            waited_s = time.monotonic() - start_s
            assert waited_s < PATIENCE_S, "waited in vain"
            await pilot.pause(min(0.02 + waited_s / 8, 0.4))  # each look is drawn anew
        await pilot.pause()

    return waited


@pytest.fixture
def settled() -> Callable[[Pilot[None]], Awaitable[None]]:
    """Fixture (pilot) that waits until every chart shows its last data and no animation runs."""

    async def waited(pilot: Pilot[None]) -> None:
        await pilot.pause()
        while any(chart._pending is not None for chart in pilot.app.screen.query(Chart)):
            await pilot.pause(0.02)
        await pilot.wait_for_scheduled_animations()

    return waited


@pytest.fixture
def snapshot() -> Snapshot:
    """Fixture (pilot, name) that compares the screen with a snapshot; DPR_LAB_UPDATE_SNAPSHOTS=1 writes a new one."""

    async def compared(pilot: Pilot[None], name: str) -> None:
        path = SNAPSHOTS / f"{name}.svg"
        if os.environ.get("DPR_LAB_UPDATE_SNAPSHOTS"):
            await pilot.pause(2.0)
            path.parent.mkdir(exist_ok=True)
            path.write_text(screen_of(pilot.app, name), encoding="utf-8")
        assert path.is_file(), f"there is no {path}: look at the screen, then run with DPR_LAB_UPDATE_SNAPSHOTS=1"
        picture, give_up = path.read_text(encoding="utf-8"), time.monotonic() + DRAWN_S
        while (seen := screen_of(pilot.app, name)) != picture and time.monotonic() < give_up:
            await pilot.pause(0.1)
        assert seen == picture, f"the screen is not the picture {path}"

    return compared


def screen_of(app: App[Any], name: str) -> str:
    """Content of the screen as a drawing."""
    # Class names carry a hash of the content, which says nothing that the content does not.
    seen = re.sub(r"terminal-\d+", "terminal", app.export_screenshot(title=name))
    return re.sub(r"@font-face \{.*?\}", "", seen, flags=re.DOTALL)  # names a server
