"""Terminal user interface, idle and during a recording at 1 kHz: number of frames, CPU load, and lost samples.

    python benchmarks/tui_redraw.py [--seconds 30] [--width 160] [--height 48] [--quick] [--json]

The application runs in a separate process on a pseudo-terminal. This program reads its output like a terminal. The
recorder and a simulated device run in real time.
"""

import fcntl
import json
import os
import pty
import re
import struct
import subprocess
import sys
import tempfile
import termios
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from _bars import Bar, at_most, options, show

from dpr_lab.tui import FRAMES_PER_S

MAX_FRAMES_PER_S = 15
MAX_CORES = 0.5
IDLE_S = 10.0
MAX_IDLE_CORES = 0.03


ASKED = re.compile(rb"\x1b\[(\d+);(\d+)H\x1b\[6n")
"""Request for the position of the cursor, which the application sends after a frame. Only answered frames count as
seen."""


def operate(folder: str, seconds: float) -> None:
    """Run the application on the pseudo-terminal.

    An automatic operator releases the rods once, and writes the measurements to a file.
    """
    import asyncio
    import time

    from rich.console import RenderableType
    from textual.pilot import Pilot
    from textual.screen import Screen

    from dpr_lab.acquisition.capture import CaptureOptions
    from dpr_lab.tui.app import DprApp
    from dpr_lab.tui.recorder.attempt import Phase
    from dpr_lab.tui.steps.capture import CaptureStep
    from dpr_lab.tui.workspace import Workspace

    class Counted(DprApp):
        frames = 0

        def _display(self, screen: Screen[Any], renderable: RenderableType | None) -> None:
            Counted.frames += 1
            super()._display(screen, renderable)

    async def pilot_it(pilot: Pilot[object]) -> None:
        step = app.query_one(CaptureStep)
        await app.services.connect()
        await reach(pilot, lambda: app.device.connected is not None)
        await pilot.press("3")
        await asyncio.sleep(1.0)
        used = time.process_time()
        await asyncio.sleep(IDLE_S)
        idle_cores = (time.process_time() - used) / IDLE_S
        step.options = CaptureOptions(duration=seconds, pose_timeout=60.0, rest_timeout=60.0)
        await pilot.press("s")
        await reach(pilot, lambda: step.attempt is not None and step.attempt.phase is Phase.READY)
        await pilot.press("r")
        await reach(pilot, lambda: step.attempt is not None and step.attempt.phase is Phase.RECORDING)
        frames, used, began = Counted.frames, time.process_time(), time.monotonic()
        await reach(pilot, lambda: step.attempt is not None and step.attempt.phase is Phase.JUDGED, 0.5)
        took = time.monotonic() - began
        captured = step.attempt.captured if step.attempt is not None else None
        assert captured is not None
        seen = {
            "frames_per_s": (Counted.frames - frames) / took,
            "cores": (time.process_time() - used) / took,
            "idle_cores": idle_cores,
            "lost": sum(captured.lost.values()),
            "ok": captured.quality.ok,
        }
        (Path(folder) / "seen.json").write_text(json.dumps(seen))
        app.exit()

    async def reach(pilot: Pilot[object], condition: Callable[[], bool], pause_s: float = 0.05) -> None:
        while not condition():
            await pilot.pause(pause_s)

    app = Counted(Workspace(link="sim://?seed=1", out=Path(folder) / "bench"), Path(folder) / "state")
    app.run(auto_pilot=pilot_it)


def watch(folder: str, seconds: float, width: int, height: int) -> dict[str, float]:
    """Run the application on a terminal of a given size.

    Returns:
        Measurements of the automatic operator, and the number of bytes that the application wrote.
    """
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))
    drawn = [0]

    def read() -> None:
        rest = b""
        try:
            while chunk := os.read(master, 65536):
                drawn[0] += len(chunk)
                rest += chunk
                for asked in ASKED.finditer(rest):
                    os.write(master, b"\x1b[%s;%sR" % asked.groups())
                rest = ASKED.split(rest)[-1][-32:]
        except OSError:
            return

    threading.Thread(target=read, daemon=True).start()
    drawing = {"TERM": "xterm-256color", "COLORTERM": "truecolor", "TEXTUAL_FPS": str(FRAMES_PER_S)}
    command = [sys.executable, __file__, "--operate", folder, "--seconds", str(seconds)]
    subprocess.run(command, stdin=slave, stdout=slave, stderr=slave, env=os.environ | drawing, check=True)
    os.close(slave)
    return json.loads((Path(folder) / "seen.json").read_text()) | {"kbyte_per_s": drawn[0] / 1e3 / seconds}


def main() -> None:
    """Run the application and print the results."""
    parser = options(__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--width", type=int, default=160, help="columns")
    parser.add_argument("--height", type=int, default=48, help="rows")
    parser.add_argument("--operate", metavar="FOLDER", help="run the application; only for use by this program")
    chosen = parser.parse_args()
    if chosen.operate:
        operate(chosen.operate, chosen.seconds)
        return
    seconds = min(chosen.seconds, 10.0) if chosen.quick else chosen.seconds
    with tempfile.TemporaryDirectory() as folder:
        seen = watch(folder, seconds, chosen.width, chosen.height)
    bars = [
        at_most("frames drawn per s while recording at 1 kHz", seen["frames_per_s"], MAX_FRAMES_PER_S),
        at_most("cores used by the screen", seen["cores"], MAX_CORES),
        at_most("cores used by the screen while nothing moves", seen["idle_cores"], MAX_IDLE_CORES),
        at_most("samples lost", seen["lost"], 0),
        Bar("recording passes the gate", "yes", float(seen["ok"]), bool(seen["ok"])),
    ]
    size = f"{chosen.width} x {chosen.height}, {seconds:g} s"
    show(f"bench screen, {size}", bars, chosen.json, seen=seen)


if __name__ == "__main__":
    main()
