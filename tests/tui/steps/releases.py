"""Keys and states of a guided release, for tests of the step Capture."""

# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

from collections.abc import Callable
from pathlib import Path

from textual.pilot import Pilot
from textual.widgets import Static

from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.attempt import Phase
from dpr_lab.tui.steps.capture import CaptureStep

SIM = "sim://?seed=1"
SECOND = CaptureOptions(duration=1.0, pose_timeout=600.0, rest_timeout=60.0)


async def connected(pilot: Pilot[None], until) -> None:
    """Wait for the first handshake. If it fails, the test fails at once with the reason, and not after minutes."""
    app = pilot.app
    assert isinstance(app, DprApp)
    await until(pilot, lambda: app.device.connected or app.device.message)
    assert app.device.connected, app.device.message


async def connect(pilot: Pilot[None], until, url: str, options: CaptureOptions = SECOND) -> CaptureStep:
    app = pilot.app
    assert isinstance(app, DprApp)
    app.workspace.link = url
    await app.services.connect()
    await connected(pilot, until)
    await pilot.press("3")
    step = app.query_one(CaptureStep)
    step.options = options
    return step


def in_phase(step: CaptureStep, phase: Phase) -> Callable[[], bool]:
    return lambda: step.attempt is not None and step.attempt.phase is phase


async def to_ready(pilot: Pilot[None], until, step: CaptureStep) -> None:
    await pilot.press("s")
    await until(pilot, in_phase(step, Phase.READY))


async def to_judged(pilot: Pilot[None], until, step: CaptureStep) -> Path:
    await to_ready(pilot, until, step)
    await pilot.press("r")
    await until(pilot, in_phase(step, Phase.JUDGED))
    return step.attempt.captured.run_file


def headline(app: DprApp) -> str:
    return str(app.query_one("#headline", Static).render())


def recorded(app: DprApp) -> list[Path]:
    return sorted((app.workspace.out / "runs").glob("*.mcap"))
