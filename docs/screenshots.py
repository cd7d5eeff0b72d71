"""Screenshots for the documentation, taken from the running app with a simulated rig.

    python docs/screenshots.py [--out docs/img] [--sizes 80x24 120x40 200x60] [--themes dpr-dark dpr-light dpr-contrast]

Writes tui-STEP-SIZE-THEME.svg for each of the seven steps at each size in each theme. This takes some minutes, because
the app records, identifies and diagnoses the rig.
"""

import argparse
import asyncio
import contextlib
import re
import tempfile
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from textual.pilot import Pilot
from textual.widgets import Static

from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.attempt import Phase
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.themes import THEMES
from dpr_lab.tui.workspace import Workspace

RIG = "sim://?plant=dry&seed=1"
PATIENCE_S = 1800.0
MID_SWING_S = 3.0
RECORD_S = 30.0
"""Duration of a recording, s: sufficient for a screenshot of each size while the rods swing."""
SETTLING_S = 1.0
"""Waiting time after a new size or theme, s."""
RELEASES = 3
"""Number of releases, from which effects can be distinguished."""
WORKING = ("4", "5", "6", "7")
"""Keys of the steps with a long computation, which `s` starts."""


async def until(pilot: Pilot[None], condition: Callable[[], object]) -> None:
    """Wait for a condition."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("a step did not reach the condition in time")
        await pilot.pause(0.1)


class Watched:
    """Confirmation of frames without a terminal."""

    multiplexer = ""

    async def seen(self, patience_s: float) -> float:
        """Return a round trip time of zero at once, s."""
        return 0.0


@dataclass(frozen=True, slots=True)
class Pictures:
    """Which pictures to take, and where they go."""

    out: Path
    sizes: Sequence[tuple[int, int]]
    themes: Sequence[str]

    async def take(self, app: DprApp, pilot: Pilot[None], themes: Sequence[str] = ()) -> None:
        """Save what is shown, at each size and in each theme, once charts are drawn and notices gone."""
        for theme in themes or self.themes:
            app.theme = theme
            for width, height in self.sizes:
                await pilot.resize_terminal(width, height)
                app.clear_notifications()
                await pilot.pause(SETTLING_S)
                name = f"tui-{app.workspace.step.lower()}-{width}x{height}-{theme.removeprefix('dpr-')}.svg"
                picture = app.export_screenshot(title=f"dpr-lab tui: {app.workspace.step}", simplify=True)
                (self.out / name).write_text(compact(picture), encoding="utf-8")
                print(self.out / name, flush=True)
        app.theme = self.themes[0]


def compact(picture: str) -> str:
    """Return the same picture in half the bytes, with a font of the reader's computer, never from the network."""
    picture = re.sub(r"@font-face \{.*?\}", "", picture, flags=re.DOTALL)
    picture = re.sub(r'<clipPath id="[^"]*-line-\d+">.*?</clipPath>', "", picture, flags=re.DOTALL)
    picture = re.sub(r' clip-path="url\(#[^"]*-line-\d+\)"| shape-rendering="crispEdges"', "", picture)
    picture = re.sub(r"terminal-\d+-(\w)", r"\1", picture)
    picture = picture.replace("<style>", "<style>rect { shape-rendering: crispEdges }", 1)
    return re.sub(r"\s*\n\s*", "\n", picture)


async def release(pilot: Pilot[None], step: CaptureStep, mid_swing: Callable[[], Awaitable[object]]) -> None:
    """One guided release, kept; `mid_swing` is awaited on the way."""
    await pilot.press("s")
    await until(pilot, lambda: step.attempt is not None and step.attempt.phase is Phase.READY)
    await pilot.press("r")
    await until(pilot, lambda: _recorded(step) >= MID_SWING_S)
    await mid_swing()
    if not step.urgent.startswith("●"):
        raise TimeoutError("the swing ended before its pictures were taken: record for longer")
    await until(pilot, lambda: step.attempt is not None and step.attempt.phase is Phase.JUDGED)
    await pilot.press("k")


def _recorded(step: CaptureStep) -> float:
    attempt = step.attempt
    return attempt.recorded.t if attempt is not None and attempt.recorded is not None else 0.0


async def tour(app: DprApp, pictures: Pictures) -> None:
    """Go through all steps; each release is pictured in a theme of its own."""
    async with app.run_test(size=pictures.sizes[0]) as pilot:
        await pilot.press("c")
        await until(pilot, lambda: app.device.connected)
        await pilot.press("l")
        await until(pilot, lambda: "link test  ✔" in str(app.query_one("#device", Static).content))
        await pictures.take(app, pilot)
        await pilot.press("2")
        await pictures.take(app, pilot)
        await pilot.press("3")
        step = app.query_one(CaptureStep)
        step.options = replace(step.options, duration=RECORD_S)
        for number in range(max(RELEASES, len(pictures.themes))):
            themes = pictures.themes[number : number + 1]
            await release(pilot, step, partial(pictures.take, app, pilot, themes) if themes else pilot.pause)
        for key in WORKING:
            await pilot.press(key, "s")
            await until(pilot, lambda: app.current.outcome() and not app.current.work)
            await pictures.take(app, pilot)


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "img")
    parser.add_argument("--sizes", nargs="+", default=["80x24", "120x40", "200x60"], help="columns x rows")
    parser.add_argument("--themes", nargs="+", default=[theme.name for theme in THEMES])
    chosen = parser.parse_args()
    sizes = [(int(width), int(height)) for width, height in (size.split("x") for size in chosen.sizes)]
    chosen.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        bench = Workspace(link=RIG, theme=chosen.themes[0])
        app = DprApp(bench, Path(folder), sight=Watched())
        pictures = Pictures(chosen.out.resolve(), sizes, chosen.themes)
        with contextlib.chdir(folder):
            asyncio.run(tour(app, pictures))


if __name__ == "__main__":
    main()
