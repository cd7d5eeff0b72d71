"""One blind trial through the real protocol: sealed, recorded, and opened once the diagnosis stands.

The truth is drawn in the device's own process. Until it is opened the lab sees its seal and its frames, nothing else.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from dpr_lab.capture import CaptureOptions, capture
from dpr_lab.device import Device
from dpr_lab.errors import DprError
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from dpr_lab.trials.score import Outcome, score
from dpr_lab.trials.truth import unsealed

Diagnose = Callable[[list[Run], Rig], dict[str, Any]]
"""Runs and rig -> the diagnosis as JSON."""


@dataclass(frozen=True, slots=True)
class Draw:
    """What the device is to draw."""

    kind: str
    level: str
    seed: int
    plant: str = "paper"
    """Plant file that it is drawn around."""

    @property
    def url(self) -> str:
        """Where the device with the drawn plant is."""
        return f"sim://?plant={self.plant}&draw_effects={self.kind}:{self.level}&seed={self.seed}&clock=fast"

    def ask(self, rig: Rig, flag: str) -> dict[str, Any]:
        """What the device says of its plant: `--seal` or `--reveal`.

        Raises:
            DprError: there is no such draw, or the device does not start.
        """
        words = ["--plant", self.plant, "--draw-effects", f"{self.kind}:{self.level}", "--seed", str(self.seed)]
        done = subprocess.run(
            [sys.executable, "-m", "sim_device", "--rig", str(rig.path or rig.name), *words, flag],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise DprError(f"the simulated device says: {done.stderr.strip()}")
        return json.loads(done.stdout)


def trial(draw: Draw, rig: Rig, out: Path, diagnose: Diagnose, on_step: Callable[[str], None]) -> Outcome:
    """Seal, record, diagnose, open and score one plant.

    Args:
        draw: what to draw
        rig: the rig file that device and lab share
        out: folder for the runs
        diagnose: the diagnosis under trial
        on_step: told what is being done

    Raises:
        DprError: the device, a recording or the diagnosis failed, or the seal is broken.
    """
    seal = draw.ask(rig, "--seal")["seal"]
    on_step(f"sealed as {seal}")
    runs = [load_run(path, rig=rig) for path in recorded(draw, rig, out)]
    on_step(f"{len(runs)} releases recorded; diagnosing")
    begin = perf_counter()
    said = diagnose(runs, rig)
    seconds = perf_counter() - begin
    truth = unsealed(draw.ask(rig, "--reveal"), seal)
    return score(said, truth, rig, kind=draw.kind, level=draw.level, seed=draw.seed, seconds=seconds, seal=seal)


def recorded(draw: Draw, rig: Rig, out: Path) -> list[Path]:
    """One run file from each of the rig's poses."""
    with Device(open_transport(draw.url, rig_file=rig.path)) as device:
        device.connect()
        return [capture(device, rig, pose, CaptureOptions(), out, confirm=lambda: True).run_file for pose in rig.poses]
