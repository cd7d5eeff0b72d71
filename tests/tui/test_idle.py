"""An idle screen draws nothing, although the device keeps reporting the angles of the rods."""

import math
import time
from collections.abc import Iterator

import numpy as np
import pytest
from textual._compositor import CompositorUpdate

from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.connection import DeviceConnection
from dpr_lab.tui.recorder.messages import Connected, Idle
from dpr_lab.tui.steps.capture import CaptureStep
from firmware_protocol.identity import DeviceInfo

INFO = DeviceInfo("1.0.0", "000051d000000001", (16384, 16384, 16384), 4000, 1000)
COUNT = math.tau / 16384
LOOKS = 24
"""Number of times that the screen checks for reports in two seconds."""
MOST_FIRST_PICTURES = 20
MOST_OF_A_CORE = 0.25
"""Maximum CPU load. It is 0.05 on a slow machine."""


@pytest.mark.slow
async def test_an_idle_capture_screen_draws_nothing_and_costs_next_to_nothing(
    lab, until, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, looks, noise = list[object](), list[float](), np.random.default_rng(1)
    display = DprApp._display

    def reports(device: DeviceConnection) -> Iterator[Idle]:
        looks.append(time.process_time())
        seen = Idle((0.0, *(math.pi + COUNT * noise.integers(0, 2, 2))), True, math.inf)
        device.note(seen)
        yield seen

    def counted(app: DprApp, screen, renderable) -> None:
        drawn.extend([renderable] if isinstance(renderable, CompositorUpdate) else [])
        display(app, screen, renderable)

    monkeypatch.setattr(DeviceConnection, "reports", reports)
    monkeypatch.setattr(DprApp, "_display", counted)
    async with lab(CaptureStep) as pilot:
        pilot.app.device.connected = Connected("sim://", INFO, 1000, (), "")
        await until(pilot, lambda: "latch CLOSED" in str(pilot.app.query_one("#status").render()))
        for _ in range(MOST_FIRST_PICTURES):  # on a loaded machine the first pictures come late
            drawn.clear()
            await pilot.pause(0.5)
            if not drawn:
                break
        drawn.clear()
        looks.clear()
        began = time.monotonic()
        while len(looks) < LOOKS:
            await pilot.pause(0.2)
        wall = time.monotonic() - began
    assert drawn == []
    assert looks[-1] - looks[0] < MOST_OF_A_CORE * wall
