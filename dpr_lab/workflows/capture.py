"""Record runs from a device: guide, release, record and check."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from dpr_lab.workflows.checks import check_folder_writable, refuse_no_poses, with_options
from dpr_lab.workflows.events import CaptureBegan, CaptureDone, CaptureProgress, DeviceGreeted, OnEvent, ignore

if TYPE_CHECKING:
    from dpr_lab.acquisition.capture import CaptureOptions
    from dpr_lab.acquisition.holding import Confirm
    from dpr_lab.acquisition.swing import Captured
    from dpr_lab.rig import Rig
    from firmware_protocol.identity import DeviceInfo


@dataclass(frozen=True, slots=True)
class CaptureResult:
    """Recorded runs and the device that recorded them."""

    url: str
    device: "DeviceInfo"
    captured: "tuple[Captured, ...]"

    @property
    def ok(self) -> bool:
        """Whether every recording passed every check."""
        return all(run.quality.ok for run in self.captured)

    @property
    def files(self) -> tuple[Path, ...]:
        """Run files in the order of their releases."""
        return tuple(run.run_file for run in self.captured)


def capture(
    rig_name: str,
    out: Path,
    options: "CaptureOptions",
    confirm: "Confirm",
    *,
    poses: Sequence[str] = (),
    repeat: int = 1,
    url: str | None = None,
    rods: str | None = None,
    elbow: str | None = None,
    arm: str | None = None,
    inner: str | None = None,
    on_event: OnEvent = ignore,
) -> CaptureResult:
    """Record free swings, one run file for each release.

    Args:
        rig_name: rig file, or name of a built-in rig
        out: folder of the runs
        options: sample rate, duration, note and time limits of the recordings
        confirm: function that permits or refuses each release, as in `dpr_lab.acquisition.capture.capture`
        poses: names of the poses in order; empty for all poses of the rig
        repeat: number of releases from each pose
        url: URL of the device; None: the link of the rig file
        rods: mounted rods; None: as in the rig file
        elbow: whether joint 2 is free or clamped; None: as in the rig file
        arm: mode of joint 0: clamped, free, prescribed or driven; None: as in the rig file
        inner: mode of joint 1: free or prescribed; None: as in the rig file
        on_event: receives `DeviceGreeted`; for each pose `CaptureBegan`, `CaptureProgress`, `CaptureDone`

    Raises:
        ConfigError: the rig is not valid or lacks a pose, or a file with the name of the folder exists.
        DprError: see `dpr_lab.acquisition.capture.capture`.
    """
    from dpr_lab.acquisition.capture import capture as capture_run
    from dpr_lab.acquisition.capture import check_encoders, pose_named
    from dpr_lab.acquisition.device import Device
    from dpr_lab.rig import load_rig
    from dpr_lab.transports import open_transport

    rig = with_options(load_rig(rig_name), rods=rods, elbow=elbow, arm=arm, inner=inner)
    for name in poses:
        pose_named(rig, name)
    refuse_no_poses(rig)
    check_folder_writable(out)
    url = rig.link.url if url is None else url
    captured: list[Captured] = []
    with _rig_file(rig) as rig_file, Device(open_transport(url, rig_file=rig_file)) as device:
        info = device.connect()
        on_event(DeviceGreeted(device.url, info))
        check_encoders(device, rig)  # before the operator moves the rods
        device.check_rate(options.rate_hz or rig.link.rate_hz)
        for name in (*(poses or rig.poses),) * repeat:
            on_event(CaptureBegan(name, rig.poses[name], options.longest, rig.rods.number))
            captured.append(
                capture_run(
                    device, rig, name, options, out, lambda progress: on_event(CaptureProgress(progress)), confirm
                )
            )
            on_event(CaptureDone(name, captured[-1]))
    return CaptureResult(url, info, tuple(captured))


@contextmanager
def _rig_file(rig: "Rig") -> Iterator[Path | None]:
    """Yield the rig file for a simulated device.

    A temporary file is written if options changed the mounted rods or the modes of the joints.
    """
    from dpr_lab.storage.metadata import rig_toml

    if rig.path is not None:
        yield rig.path
        return
    with TemporaryDirectory() as folder:
        file = Path(folder) / "rig.toml"
        file.write_text(rig_toml(rig), encoding="utf-8")
        yield file
