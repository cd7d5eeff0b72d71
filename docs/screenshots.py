"""Pictures of the bench screen for the documentation, taken from the real app at work with a simulated rig.

    python docs/screenshots.py [--out docs/img] [--size 110x32] [--theme dpr-dark]

Writes tui-connect.svg, tui-rig.svg, tui-capture.svg, tui-identify.svg, tui-compare.svg and tui-diagnose.svg; takes some
minutes, since everything shown is really recorded, identified and diagnosed.
"""

import argparse
import asyncio
import re
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from textual.pilot import Pilot

from dpr_lab.tui.app import DprApp
from dpr_lab.tui.attempt import Phase
from dpr_lab.tui.bench import Bench
from dpr_lab.tui.capture import CaptureStep

RIG = "sim://?plant=dry&seed=1"
PATIENCE_S = 1800.0
MID_SWING_S = 6.0
WORKING = ("4", "5", "6")
"""Keys of the steps that are started by `s` and take their time."""


async def until(pilot: Pilot[None], condition: Callable[[], object]) -> None:
    """Wait for a condition."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("a step did not get there")
        await pilot.pause(0.1)


async def take(app: DprApp, pilot: Pilot[None], out: Path) -> None:
    """Save what is shown, once charts are drawn and notices gone."""
    app.clear_notifications()
    await pilot.pause(1.0)
    name = f"tui-{app.bench.step.lower()}"
    picture = app.export_screenshot(title=f"dpr-lab tui: {app.bench.step}")
    # The font is to come from the reader's computer, never from the network.
    (out / f"{name}.svg").write_text(re.sub(r"@font-face \{.*?\}", "", picture, flags=re.DOTALL), encoding="utf-8")
    print(out / f"{name}.svg")


async def release(pilot: Pilot[None], step: CaptureStep, mid_swing: Callable[[], Awaitable[object]]) -> None:
    """One guided release, kept; `mid_swing` is awaited on the way."""
    await pilot.press("s")
    await until(pilot, lambda: step.attempt is not None and step.attempt.phase is Phase.READY)
    await pilot.press("r")
    await until(pilot, lambda: _recorded(step) >= MID_SWING_S)
    await mid_swing()
    await until(pilot, lambda: step.attempt is not None and step.attempt.phase is Phase.JUDGED)
    await pilot.press("k")


def _recorded(step: CaptureStep) -> float:
    attempt = step.attempt
    return attempt.recorded.t if attempt is not None and attempt.recorded is not None else 0.0


async def tour(app: DprApp, size: tuple[int, int], out: Path) -> None:
    """Go through all steps."""
    async with app.run_test(size=size) as pilot:
        await pilot.press("c")
        await until(pilot, lambda: app.line.connected)
        await pilot.press("x")
        await pilot.pause(4.0)
        await take(app, pilot, out)
        await pilot.press("2")
        await take(app, pilot, out)
        await pilot.press("3")
        step = app.query_one(CaptureStep)
        for number in range(3):
            await release(pilot, step, lambda number=number: take(app, pilot, out) if number == 1 else pilot.pause())
        for key in WORKING:
            await pilot.press(key, "s")
            await until(pilot, lambda: app.current.outcome())
            await take(app, pilot, out)


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "img")
    parser.add_argument("--size", default="110x32", help="columns x rows")
    parser.add_argument("--theme", default="dpr-dark")
    chosen = parser.parse_args()
    width, height = map(int, chosen.size.split("x"))
    chosen.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(link=RIG, out=Path(folder) / "bench", theme=chosen.theme)
        asyncio.run(tour(DprApp(bench, Path(folder)), (width, height), chosen.out))


if __name__ == "__main__":
    main()
