"""Long recordings in real time: lost samples, growth of memory, and CPU load.

    python benchmarks/soak.py [--jobs serial can serial-4khz] [--minutes M] [--quick] [--json]

Each job has a simulated device in a separate process and a recorder like `dpr-lab capture`. All jobs run at the same
time. Without --minutes, the jobs at 1 kHz take an hour and the job at 4 kHz ten minutes. With --quick, all take one
minute.
"""

import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from _bars import Bar, at_most, options, show

MEMORY_EVERY_S = 2.0
SETTLED_AFTER = 0.3  # share of a recording during which caches fill
SHORTEST_FOR_MEMORY_MIN = 4.0


@dataclass(frozen=True)
class Job:
    """Settings of one recording."""

    link: str
    rate_hz: int
    minutes: float


JOBS = {
    "serial": Job("sim://?clock=realtime&baud=921600", 1000, 60),
    "can": Job("sim://?clock=realtime&bus=can", 1000, 60),
    "serial-4khz": Job("sim://?clock=realtime&baud=921600", 4000, 10),
}


def resident_mb() -> float:
    """Resident memory of this process, MB."""
    with Path("/proc/self/statm").open() as statm:
        return int(statm.read().split()[1]) * resource.getpagesize() / 1e6


def record(name: str, seconds: float, folder: str) -> dict[str, float]:
    """Record one capture, and return its losses, memory and CPU load."""
    from dpr_lab.acquisition.capture import CaptureOptions, Progress, SwingReading, capture
    from dpr_lab.acquisition.device import Device
    from dpr_lab.acquisition.settings import CAPTURE_SETTINGS
    from dpr_lab.rig import load_rig
    from dpr_lab.transports import open_transport

    rig = load_rig("paper")
    memory: list[tuple[float, float]] = []
    heard = [time.monotonic(), 0.0]
    """Time of the last progress message, and the longest interval between two messages, s."""

    def on_progress(event: Progress) -> None:
        now = time.monotonic()
        if isinstance(event, SwingReading) and event.t > 1.0:
            heard[1] = max(heard[1], now - heard[0])
        heard[0] = now
        if not memory or now - memory[-1][0] >= MEMORY_EVERY_S:
            memory.append((now, resident_mb()))

    with Device(open_transport(JOBS[name].link, rig_file=rig.path)) as device:
        device.connect()
        began, used = time.monotonic(), time.process_time()
        options = CaptureOptions(rate_hz=JOBS[name].rate_hz, duration=seconds)
        captured = capture(device, rig, "X1", options, Path(folder) / name, on_progress, lambda: True)
        used, took = time.process_time() - used, time.monotonic() - began
    at, resident = np.array(memory[int(SETTLED_AFTER * len(memory)) :]).T
    return {
        "lost": sum(captured.lost.values()),
        "seconds": captured.duration,
        "ok": captured.quality.ok,
        "late_ms": 1e3 * max(0.0, heard[1] - CAPTURE_SETTINGS.report_s),
        "core_percent": 100 * used / took,
        "memory_mb": float(resident[-1]),
        "growth_mb_per_hour": float(np.polyfit(at - at[0], resident, 1)[0]) * 3600 if len(at) > 2 else 0.0,
        "file_mb": captured.run_file.stat().st_size / 1e6,
        "verified": _verified(captured.run_file),
    }


def _verified(run_file: Path) -> bool:
    command = [sys.executable, "-m", "dpr_lab", "run", "verify", run_file]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0


def _bars(name: str, minutes: float, figures: dict[str, float]) -> list[Bar]:
    wanted = 60 * minutes
    growth = at_most(f"{name}: memory growth, MB/h", figures["growth_mb_per_hour"], 5)
    if minutes < SHORTEST_FOR_MEMORY_MIN:  # one megabyte of the allocator would count as 60 MB/h
        growth = Bar(growth.bar, growth.target, growth.measured, None)
    core = at_most(f"{name}: share of a core, %", figures["core_percent"], 25)
    sound = bool(figures["verified"] and figures["ok"])
    return [
        at_most(f"{name}: samples lost", figures["lost"], 0),
        Bar(f"{name}: recorded, s", f">= {wanted:g}", figures["seconds"], figures["seconds"] >= wanted - 0.02),
        Bar(f"{name}: host late at most, ms", "< 500", figures["late_ms"], figures["late_ms"] < 500),
        core if JOBS[name].rate_hz <= 1000 else Bar(core.bar, "-", core.measured, None),
        growth,
        Bar(f"{name}: file verified and gate passed", "1", float(sound), sound),
    ]


def main() -> None:
    """Run all jobs and print the results."""
    parser = options(__doc__)
    parser.add_argument("--minutes", type=float, help="duration of each job, minutes")
    parser.add_argument("--jobs", nargs="+", choices=JOBS, default=list(JOBS))
    chosen = parser.parse_args()
    minutes = {name: 1.0 if chosen.quick else chosen.minutes or JOBS[name].minutes for name in chosen.jobs}
    with tempfile.TemporaryDirectory() as folder, get_context("spawn").Pool(len(minutes)) as pool:
        jobs = {name: pool.apply_async(record, (name, 60 * long, folder)) for name, long in minutes.items()}
        results = {name: job.get() for name, job in jobs.items()}
    bars = [bar for name, result in results.items() for bar in _bars(name, minutes[name], result)]
    show("soak", bars, chosen.json, minutes=minutes, results=results)


if __name__ == "__main__":
    main()
