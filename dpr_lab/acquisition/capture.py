"""Capture of a run: from the pose through the release to a checked run file.

    check the hanging rods -> hold -> guide to the pose -> stream -> wait for rest -> permission -> release ->
    record -> stop -> quality gate

Progress is reported by events; nothing is printed. Only the command RELEASE releases the rods. This command is sent
only after pose and rest were checked and the caller has given permission. If a capture ends before RELEASE, the rods
stay held.
"""

import math
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeAlias

from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.holding import (
    Confirm,
    HangReading,
    HeldPose,
    PoseReading,
    RestReading,
    guide,
    look_at_hanging,
)
from dpr_lab.acquisition.live_speed import LiveSpeed
from dpr_lab.acquisition.settings import CAPTURE_SETTINGS, CaptureSettings
from dpr_lab.acquisition.swing import Captured, Released, SwingReading, SwingRecorder
from dpr_lab.errors import ConfigError, DprError, unknown_name
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Pose
from dpr_lab.storage.layout import SUFFIX
from dpr_lab.storage.metadata import RunMetadata
from dpr_lab.storage.spool import check_room
from firmware_protocol.identity import DeviceInfo


@dataclass(frozen=True, slots=True)
class CaptureOptions:
    """Options of a recording."""

    rate_hz: int | None = None
    """Sample rate, Hz; None: the rate of the rig file."""
    duration: float = 10.0
    """Duration of the recording after the release, s."""
    until_rest: bool = False
    """Whether the recording ends when both rods have come to rest (at the latest after `max_duration`) instead of after
    `duration`."""
    max_duration: float = 180.0
    pose_timeout: float = 120.0
    """Maximum time to move the rods to the pose, s."""
    rest_timeout: float = 15.0
    """Maximum time for the held rods to come to rest, s."""
    note: str = ""
    """Note of the operator, stored with the run."""

    def __post_init__(self) -> None:
        """Refuse invalid options.

        Raises:
            ValueError: a rate that is not a positive integer, or a time that is not positive and finite.
        """
        if self.rate_hz is not None and not (isinstance(self.rate_hz, int) and self.rate_hz > 0):
            raise ValueError(
                f"rate_hz = {self.rate_hz!r}: must be a positive whole number, or None for the rate of the rig"
            )
        for name in ("duration", "max_duration", "pose_timeout", "rest_timeout"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be a positive, finite time in s")

    @property
    def longest(self) -> float:
        """Maximum duration of the recording, s."""
        return self.max_duration if self.until_rest else self.duration


Progress: TypeAlias = HangReading | PoseReading | RestReading | Released | SwingReading
OnProgress: TypeAlias = Callable[[Progress], None]


def refuse() -> bool | None:
    """Never permit the release; this function is the default of the argument `confirm`."""
    return False


def ignore(progress: Progress) -> None:
    """Ignore all events; this function is the default of the argument `on_progress`."""


def capture(
    device: Device,
    rig: Rig,
    pose_name: str,
    options: CaptureOptions,
    out_dir: Path,
    on_progress: OnProgress = ignore,
    confirm: Confirm = refuse,
    settings: CaptureSettings = CAPTURE_SETTINGS,
) -> Captured:
    """Guide the rods to a pose, release them, record, and check the recording.

    Args:
        device: a connected device
        rig: the rig on which the device is mounted
        pose_name: name of a pose of the rig
        options: rate, duration and limits
        out_dir: folder for the run file, created if missing
        on_progress: called with every step, in this thread
        confirm: called when the rods are at rest; returns True to release, False to stop, None to be called again a
        moment later
        settings: timing of the capture, and limits of rest

    Raises:
        ConfigError: the pose is unknown, or the device does not match the rig.
        LinkError, DeviceFault: see `Device`.
        SafetyStop: a check before the release failed, or no permission was given; the rods stay held.
        RunError: the disk has no space for the file (detected before the rods move), or writing failed; the recorded
            data are kept.
        DeviceLost: the connection was lost before the recording was complete; the message names the partial file if
            there is one.
        KeyboardInterrupt: re-raised with the name of the file, after the file was finished as incomplete and the device
            was stopped.
    """
    pose, rate_hz = pose_named(rig, pose_name), options.rate_hz or rig.link.rate_hz
    check_encoders(device, rig)
    device.check_rate(rate_hz)
    check_room(out_dir, options.longest * rate_hz)
    metadata = _metadata(device, rig, pose_name, rate_hz, options.note)
    speed = LiveSpeed(rig, rate_hz)
    recorder = SwingRecorder(device, options.longest, options.until_rest, speed, on_progress, settings)
    try:
        device.stop()  # An earlier program may have left the device streaming. The latch keeps its state.
        device.poll(0)
        hanging = look_at_hanging(device, rig, on_progress, settings)
        device.hold(1 + list(rig.poses).index(pose_name))
        guide(device, rig, pose, options.pose_timeout, on_progress, settings)
        device.stream(rate_hz)
        held = HeldPose(device, rig, pose, rate_hz, on_progress, settings)
        held.await_rest(options.rest_timeout)
        held.await_go_ahead(confirm)
        path = new_path(out_dir, pose_name, device.info.uid)
        return recorder.record(path, metadata, held.window, hanging)
    except BaseException:
        with suppress(DprError, KeyboardInterrupt):  # the first error is raised again
            device.stop()
        raise


def new_path(out_dir: Path, pose_name: str, uid: str) -> Path:
    """Choose the path of a new run file: `<utc>_<pose>_<uid8>.mcap`."""
    stem = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}_{in_file_name(pose_name)}_{uid[-8:]}"
    path, number = out_dir / f"{stem}{SUFFIX}", 1
    while path.exists():
        number += 1
        path = out_dir / f"{stem}-{number}{SUFFIX}"
    return path


def in_file_name(pose_name: str) -> str:
    """Convert the name of a pose to the form used in file names of runs."""
    return re.sub(r"[^A-Za-z0-9.-]", "-", pose_name)


def check_encoders(device: Device, rig: Rig) -> None:
    """Check that the encoders of a device have the resolutions in the rig file.

    Raises:
        ConfigError: the counts per turn of a joint differ.
    """
    of_rig, of_device = rig.encoders.counts_per_rev, device.info.counts_per_rev
    if of_rig != of_device:
        raise ConfigError(
            f"{rig.path or rig.name}: encoders.counts_per_rev = {list(of_rig)}, but the device at {device.url} has"
            f" {list(of_device)}: correct the rig file, or choose the device that belongs to it"
        )


def pose_named(rig: Rig, name: str) -> Pose:
    """Return a pose of a rig.

    Raises:
        ConfigError: the rig has no pose with this name.
    """
    if name not in rig.poses:
        raise ConfigError(unknown_name(f"{rig.path or rig.name}: has no pose {name!r}", name, rig.poses))
    return rig.poses[name]


def _metadata(device: Device, rig: Rig, pose_name: str, rate_hz: int, note: str) -> RunMetadata:
    info = device.info
    return RunMetadata(
        rig=rig,
        pose=pose_name,
        rate_hz=rate_hz,
        url=device.url,
        firmware=info.firmware,
        uid=info.uid,
        protocol=f"{info.major}.{info.minor}",
        schema_hash=f"{info.schema_hash:08x}",
        note=note,
        extra={"simulated_time": str(device.simulated_time).lower(), **_drives(info, rig)},
    )


def _drives(info: DeviceInfo, rig: Rig) -> dict[str, str]:
    """Return the metadata on the torques of a run, or on the arm's input.

    The result is empty for a device without drives.

    Raises:
        ConfigError: the input differs from the rig file, or the device reports torques of the joints as well.
    """
    if info.input_quantity is not None and rig.arm.mode == "driven" and rig.motor is not None:
        quantity = info.input_quantity.name.lower()
        if quantity != rig.motor.input:
            raise ConfigError(
                f"{rig.path or rig.name}: motor.input is {rig.motor.input}, but the device reports a"
                f" {quantity}: correct the rig file"
            )
        if info.torque_kinds:
            raise ConfigError(
                "the device reports torques of joints 1 and 2 in addition to the input of its arm, but a"
                " run can contain only one of them: disable one in its firmware"
            )
        kind = info.input_kinds[0].name.lower()
        return {"arm": "driven", "input_kind": kind, "input_unit_micro": str(info.input_unit)}
    if not info.torque_kinds:
        return {}
    return {"torque_kind": info.torque_kinds[0].name.lower(), "torque_unit_uNm": str(info.torque_unit_uNm)}
