"""Long recordings in real time: nothing lost, memory flat, little of a core used.

    python benchmarks/soak.py [--minutes 10] [--rate 1000] [--links serial can] [--quick] [--json]

Each link gets a simulated device in a process of its own and a recorder like `dpr-lab capture`, all at the same time.
"""

import resource
import subprocess
import sys
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

from _bars import Bar, at_most, options, show

LINKS = {"serial": "sim://?clock=realtime&baud=921600", "can": "sim://?clock=realtime&bus=can"}
MEMORY_SAMPLES_S = 5.0


def resident_mb() -> float:
    """Resident memory of this process, MB."""
    with Path("/proc/self/statm").open() as statm:
        return int(statm.read().split()[1]) * resource.getpagesize() / 1e6


def record(link: str, seconds: float, rate_hz: int, folder: str) -> dict[str, float]:
    """One capture; what it lost and what it took."""
    from dpr_lab.capture import CaptureOptions, Progress, capture
    from dpr_lab.device import Device
    from dpr_lab.rig import load_rig
    from dpr_lab.transports import open_transport

    rig = load_rig("paper")
    memory: list[float] = []
    late = [0.0, time.monotonic()]

    def on_progress(event: Progress) -> None:
        now = time.monotonic()
        late[0], late[1] = max(late[0], now - late[1]), now
        if len(memory) * MEMORY_SAMPLES_S < now - began:
            memory.append(resident_mb())

    with Device(open_transport(LINKS[link], rig_file=rig.path)) as device:
        device.connect()
        began = time.monotonic()
        used = time.process_time()
        options = CaptureOptions(rate_hz=rate_hz, duration=seconds)
        captured = capture(device, rig, "X1", options, Path(folder) / link, on_progress, lambda: True)
        used, took = time.process_time() - used, time.monotonic() - began
    settled = memory[len(memory) // 10 :] or memory
    return {
        "lost": sum(captured.lost.values()),
        "seconds": captured.duration,
        "ok": captured.verdict.ok,
        "core_percent": 100 * used / took,
        "memory_mb": memory[-1],
        "growth_mb_per_hour": (settled[-1] - settled[0]) / max(took, 1e-9) * 3600,
        "file_mb": captured.run_file.stat().st_size / 1e6,
        "verified": subprocess.run(
            [sys.executable, "-m", "dpr_lab", "run", "verify", captured.run_file], check=False, capture_output=True
        ).returncode
        == 0,
    }


def main() -> None:
    """Measure and print."""
    parser = options(__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=int, default=1000, help="Hz")
    parser.add_argument("--links", nargs="+", choices=LINKS, default=list(LINKS))
    chosen = parser.parse_args()
    seconds = 60.0 * (0.2 if chosen.quick else chosen.minutes)
    with tempfile.TemporaryDirectory() as folder, get_context("spawn").Pool(len(chosen.links)) as pool:
        jobs = {link: pool.apply_async(record, (link, seconds, chosen.rate, folder)) for link in chosen.links}
        results = {link: job.get() for link, job in jobs.items()}
    bars = []
    for link, found in results.items():
        bars += [
            at_most(f"{link}: samples lost", found["lost"], 0),
            Bar(f"{link}: recorded, s", f">= {seconds:g}", found["seconds"], found["seconds"] >= seconds - 0.02),
            at_most(f"{link}: share of a core, %", found["core_percent"], 25),
            at_most(f"{link}: memory growth, MB/h", found["growth_mb_per_hour"], 50),
            Bar(f"{link}: file verified and gate passed", "1", float(found["verified"]), bool(found["verified"])),
        ]
    show(f"soak: {seconds / 60:g} min at {chosen.rate} Hz", bars, chosen.json, results=results)


if __name__ == "__main__":
    main()
