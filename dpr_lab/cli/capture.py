"""`dpr-lab capture`: guide the rods to each pose, release, record, judge."""

import math
import select
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import positive, refuse_file, refuse_unknown_poses
from dpr_lab.cli.console import Bar, emit, json_mode, progress, say

if TYPE_CHECKING:
    from dpr_lab.capture import Captured, CaptureOptions, Confirm, OnProgress, Progress
    from dpr_lab.device import Device
    from dpr_lab.rig import Rig

DEGRADED = 6


def capture(
    rig: Annotated[str, typer.Option(help="Rig file, or the name of a built-in one.")],
    link: Annotated[
        str | None,
        typer.Option(help="Where the device is, e.g. serial:///dev/ttyACM0?baud=921600; the rig file's when left out."),
    ] = None,
    pose: Annotated[list[str] | None, typer.Option(help="Pose to release from, repeatable; all when left out.")] = None,
    duration: Annotated[float, typer.Option(callback=positive, help="How long to record after the release, s.")] = 10.0,
    until_rest: Annotated[
        bool, typer.Option("--until-rest", help="Record until both rods are at rest, at most 180 s.")
    ] = False,
    repeat: Annotated[int, typer.Option(min=1, help="How often to go through the poses.")] = 1,
    rate_hz: Annotated[int | None, typer.Option(min=1, help="Sample rate; the rig file's when left out.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Release as soon as the checks pass, without asking.")] = False,
    note: Annotated[str, typer.Option(help="Words to keep with the runs.")] = "",
    out: Annotated[Path, typer.Option(help="Folder of the runs.")] = Path("runs"),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Record free swings: one run file for each release.

    The rods are let go only at the pose, at rest, and on the operator's order: Enter on a terminal; without a
    terminal, or with --yes, the poses named on the command line are that order.

    Example: dpr-lab capture --rig paper --link sim:// --pose X1 --pose X2 --pose X3 --out runs
    """
    json_mode(as_json)
    from dpr_lab.capture import CaptureOptions
    from dpr_lab.rig import load_rig

    described = load_rig(rig)
    options = CaptureOptions(rate_hz=rate_hz, duration=duration, until_rest=until_rest, note=note)
    poses = (pose or list(described.poses)) * repeat
    refuse_unknown_poses(described, pose or [])
    refuse_file(out)
    url = link or described.link.url
    captured, device = record(url, described, poses, options, out, ask=not yes and sys.stdin.isatty())
    if as_json:
        emit(
            {
                "link": url,
                "device": device,
                "runs": [_record(run) for run in captured],
            }
        )
    else:
        for run in captured:
            print(run.run_file)
    if not all(run.verdict.ok for run in captured):
        raise typer.Exit(DEGRADED)


def record(
    url: str, rig: "Rig", poses: list[str], options: "CaptureOptions", out: Path, *, ask: bool
) -> "tuple[list[Captured], dict[str, Any]]":
    """Open a device and capture one run for each pose named; also what the device said it is."""
    from dataclasses import asdict

    from dpr_lab.device import Device
    from dpr_lab.transports import open_transport

    with Device(open_transport(url, rig_file=rig.path)) as device:
        info = device.connect()
        say(f"{device.url}: device {info.uid}, firmware {info.firmware}")
        try:
            return [_release(device, rig, pose, options, out, ask) for pose in poses], asdict(info)
        except KeyboardInterrupt as stopped:
            say(str(stopped) or "stopped by the operator; nothing was released, the rods are as they were")
            raise


def _release(device: "Device", rig: "Rig", pose: str, options: "CaptureOptions", out: Path, ask: bool) -> "Captured":
    from dpr_lab.capture import capture as capture_run

    say(f"{pose}: bring the rods to {_angles(rig.poses[pose].theta)} and hold")
    with progress(pose, options.max_duration if options.until_rest else options.duration) as bar:
        captured = capture_run(device, rig, pose, options, out, _listener(bar), _operator(ask))
    say(f"{pose}: {captured.run_file.name}: {captured.verdict.sentence}")
    return captured


def _listener(bar: Bar) -> "OnProgress":
    from dpr_lab.capture import HangReading, PoseReading, Recorded, Released, RestReading

    def on_progress(event: "Progress") -> None:
        match event:
            case HangReading(ok=False):
                off = " and ".join(f"{math.degrees(error):+.1f} deg" for error in event.error)
                say(f"the rods hang {off} off straight down: counts were lost, or the rig file's zero is wrong")
            case PoseReading():
                away = " and ".join(f"{math.degrees(error):+.1f} deg" for error in event.error)
                bar(0, f"{away} from the pose (within {math.degrees(event.tolerance):.1f} deg)")
            case RestReading():
                bar(0, f"at the pose, moving at {event.speed:.3f} rad/s")
            case Released():
                bar(0, "released")
            case Recorded():
                bar(event.t, f"{event.t:.1f} s, {event.samples} samples")

    return on_progress


def _operator(ask: bool) -> "Confirm":
    """The operator's order to release: Enter on the terminal, looked for without blocking."""
    if not ask:
        return lambda: True
    asked = [False]

    def confirm() -> bool | None:
        if not asked[0]:
            asked[0] = True
            say("at the pose and at rest: press Enter to RELEASE, Ctrl-C to stop")
        if not select.select([sys.stdin], [], [], 0)[0]:
            return None
        return sys.stdin.readline() != ""

    return confirm


def _angles(theta: Any) -> str:
    return f"theta1 = {math.degrees(theta[1]):.1f} deg, theta2 = {math.degrees(theta[2]):.1f} deg (0 = upright)"


def _record(captured: "Captured") -> dict[str, Any]:
    from dataclasses import asdict

    from dpr_lab.storage.inspect import info

    kept = asdict(info(captured.run_file))
    told = ("file", "pose", "samples", "duration_s", "release_tick", "lost", "pose_measured_rad", "sha256")
    return {name: kept[name] for name in told} | {
        "ok": captured.verdict.ok,
        "verdict": captured.verdict.to_json(),
    }
