"""Steps before a release: hold the rods, guide them to the pose, wait for rest and for permission."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from dpr_lab.acquisition.batch import Batch, arrays
from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.rest import RodAngles, RodPair, arm_restless, elbow_error, pose_error, rest_motion
from dpr_lab.acquisition.settings import CaptureSettings
from dpr_lab.arrays import Array
from dpr_lab.errors import DeviceFault, LeaseLost, SafetyStop
from dpr_lab.rig import JOINTS, Rig
from dpr_lab.rig_tables import Pose
from firmware_protocol.messages import Event, EventKind, Message, Position, State, Status, explain, explain_fault

HANGING = Pose(theta1=np.pi, theta2=np.pi)


@dataclass(frozen=True, slots=True)
class PoseReading:
    """Event: angles of the rods while the operator places them."""

    theta: RodAngles
    """Absolute angles, rad."""
    error: RodPair
    """Measured minus required angle of inner and outer rod without whole turns, rad."""
    tolerance: float
    ok: bool


@dataclass(frozen=True, slots=True)
class RestReading:
    """Event: angles and residual motion of the held rods."""

    theta: RodAngles
    """Newest absolute angles, rad."""
    error: RodPair
    """Measured minus required angle of inner and outer rod without whole turns, rad."""
    tolerance: float
    speed: float
    """Largest drift of a rod, rad/s."""
    spread: float
    """Largest vibration of a rod, rad rms."""
    ok: bool
    """Whether the rods are at rest."""
    restless: str
    """Reason why the rods may not be released; empty if a release is permitted."""
    arm: str = ""
    """Reason why a movable arm forbids the release; empty if the arm permits it."""


@dataclass(frozen=True, slots=True)
class HangReading:
    """Event: deviation of the hanging rods from the vertical before they are raised."""

    error: RodPair
    """Signed deviation of inner and outer rod from the vertical, rad."""
    ok: bool
    """Whether the deviation is within `QualityLimits.hang_error`. A larger deviation means that counts were lost or
    that the zero in the rig file is wrong."""


OnReading: TypeAlias = Callable[["PoseReading | RestReading | HangReading"], None]
Confirm: TypeAlias = Callable[[], bool | None]


class RestWindow:
    """Samples of the held rods in the last `window_s` seconds of device time."""

    def __init__(self, rate_hz: int, window_s: float) -> None:
        self.batches: deque[Batch] = deque()
        self._rate_hz = rate_hz
        self._ticks = round(window_s * rate_hz)

    @property
    def lost_before(self) -> Mapping[str, int]:
        """Number of samples lost before the oldest batch, by cause; empty without a batch."""
        return self.batches[0].lost_before if self.batches else {}

    def add(self, batches: Iterable[Batch]) -> None:
        """Add new batches, and remove samples older than the window."""
        self.batches.extend(batches)
        newest = next((batch.rows[-1].tick for batch in reversed(self.batches) if batch.rows), 0)
        while len(self.batches) > 1 and _last_tick(self.batches[0]) < newest - self._ticks:
            self.batches.popleft()

    def silent_s(self, now: float) -> float:
        """Return the time since the arrival of the newest sample, s.

        The time is infinite if there is no sample.
        """
        return now - max((batch.host_time for batch in self.batches if batch.rows), default=-np.inf)

    def motion(self, rig: Rig) -> tuple[Array, Array] | None:
        """Return times (n,), s, and angles (n, 3), rad; None until the window is full."""
        ticks, counts = arrays([row for batch in self.batches for row in batch.rows])
        if len(ticks) < 2 or ticks[-1] - ticks[0] < 0.9 * self._ticks:
            return None
        return ticks / self._rate_hz, rig.mounted_theta(counts)


def _last_tick(batch: Batch) -> int:
    return batch.rows[-1].tick if batch.rows else -1


def raise_faults(url: str, batches: Iterable[Batch]) -> None:
    """Raise an exception if a message reports a fault or an expired lease.

    Raises:
        DeviceFault: the device reports a fault.
        LeaseLost: the device has stopped streaming, because it received no messages of the host.
    """
    for batch in batches:
        for message in batch.messages:
            _raise_for(url, message)


def _raise_for(url: str, message: Message) -> None:
    if isinstance(message, Event) and message.kind is EventKind.LEASE_LOST:
        raise LeaseLost(f"{url}: {' '.join(explain(message.kind))}")
    if isinstance(message, Event) and message.kind is EventKind.FAULT:
        raise DeviceFault(f"{url}: {explain_fault(message.detail)}")
    if isinstance(message, Status) and message.state is State.FAULT:
        raise DeviceFault(f"{url}: {' '.join(explain(message.fault))}")


def _raise_if_open(url: str, batches: Iterable[Batch]) -> None:
    """Raise an exception if the device reports an open latch after the command HOLD."""
    for message in (message for batch in batches for message in batch.messages):
        let_go = isinstance(message, Event) and message.kind is EventKind.RELEASED
        if let_go or (isinstance(message, Status) and not message.latched):
            raise DeviceFault(
                f"{url}: the device reports an open latch, although HOLD was sent and RELEASE was not. The rods may"
                " be free: keep clear until you have checked them, then check latch and firmware"
            )


def look_at_hanging(device: Device, rig: Rig, on_reading: OnReading, settings: CaptureSettings) -> RodPair | None:
    """Return the deviation of the hanging rods from the vertical, rad.

    The result is None if the rods do not hang at rest with the latch open, or if a clamped elbow tilts them.
    """
    if rig.rods.mounting == "clamped":
        return None
    readings: list[Array] = []
    deadline = time.monotonic() + settings.hang_timeout_s
    spread = np.sqrt(12) * settings.limits.rest.spread(rig)
    for theta in _positions(device, rig, deadline, settings.poll_s):
        if device.status is None:
            continue
        readings.append(pose_error(theta, HANGING))
        held = device.status.latched or np.abs(readings[-1]).max() > settings.hang_near
        if held or np.ptp(readings, axis=0).max() > spread:
            return None
        if len(readings) == settings.hang_readings:
            inner, outer = np.mean(readings, axis=0).tolist()
            on_reading(HangReading((inner, outer), max(abs(inner), abs(outer)) <= settings.limits.hang_error))
            return inner, outer
    return None


def _positions(device: Device, rig: Rig, deadline: float, poll_s: float) -> Iterator[Array]:
    """Yield the angles (3,) from POSITION messages until the deadline, rad."""
    counts: dict[int, int] = {}
    while time.monotonic() < deadline:
        batches = device.poll(poll_s)
        raise_faults(device.url, batches)
        for position in (m for batch in batches for m in batch.messages if isinstance(m, Position)):
            counts[position.joint] = position.position
            if len(counts) == JOINTS and position.joint == JOINTS - 1:
                yield rig.mounted_theta([counts[joint] for joint in range(JOINTS)])


def guide(
    device: Device, rig: Rig, pose: Pose, timeout: float, on_reading: OnReading, settings: CaptureSettings
) -> None:
    """Report the error of the pose until several consecutive readings are within the tolerance.

    Raises:
        SafetyStop: the pose was not reached in time, or the elbow is clamped at another angle.
    """
    reading, steady = None, 0
    for theta in _positions(device, rig, time.monotonic() + timeout, settings.poll_s):
        _check_elbow(theta, pose, rig, settings)
        reading = _pose_reading(theta, pose, rig)
        steady = steady + 1 if reading.ok else 0
        on_reading(reading)
        if steady == settings.steady_readings:
            return
    raise SafetyStop(_not_placed(pose, reading, timeout, rig))


def _check_elbow(theta: Array, pose: Pose, rig: Rig, settings: CaptureSettings) -> None:
    """Compare the angle of a clamped elbow with the elbow angle of the pose.

    The operator cannot change this angle at the pose.
    """
    if rig.rods.mounting != "clamped" or abs(error := elbow_error(theta, pose)) <= settings.elbow_error:
        return
    wanted = pose.theta2 - pose.theta1
    raise SafetyStop(
        f"the elbow is clamped at theta2 - theta1 = {wanted + error:.2f} rad, but the pose needs {wanted:.2f} rad"
        f" (within {settings.elbow_error:g} rad): clamp it there, or choose another pose; nothing was released, the"
        " rods stay held"
    )


def _pose_reading(theta: Array, pose: Pose, rig: Rig) -> PoseReading:
    angles, error = _placed(theta, pose)
    worst = max(map(abs, error[: rig.rods.placed]))
    return PoseReading(angles, error, pose.tolerance, worst <= pose.tolerance)


def _placed(theta: Array, pose: Pose) -> tuple[RodAngles, RodPair]:
    theta0, theta1, theta2 = theta.tolist()
    error1, error2 = pose_error(theta, pose).tolist()
    return (theta0, theta1, theta2), (error1, error2)


def _not_placed(pose: Pose, reading: PoseReading | None, timeout: float, rig: Rig) -> str:
    if reading is None:
        return f"the device sent no positions within {timeout:g} s; nothing was released, the rods stay held"
    errors = zip(rig.rods.names, reading.error[: rig.rods.placed], strict=False)
    rod, worst = max(errors, key=lambda pair: abs(pair[1]))
    return (
        f"the rods did not reach the pose within {timeout:g} s: the {rod} is {worst:+.3f} rad away, tolerance"
        f" {pose.tolerance} rad; nothing was released, the rods stay held"
    )


class HeldPose:
    """State between pose and release, in which the rods are held and the device streams."""

    def __init__(
        self, device: Device, rig: Rig, pose: Pose, rate_hz: int, on_reading: OnReading, settings: CaptureSettings
    ) -> None:
        self.window = RestWindow(rate_hz, settings.limits.rest.window_s)
        self._settings = settings
        self._device, self._rig, self._pose, self._on_reading = device, rig, pose, on_reading
        self._report_at = 0.0

    def await_rest(self, timeout: float) -> None:
        """Wait until the rods are at rest at the pose.

        They must stay at rest for the duration in `RestLimits`.

        Raises:
            SafetyStop: the rods were not at rest at the pose within `timeout` s.
        """
        deadline = time.monotonic() + timeout
        while (restless := self._look(self._settings.poll_s)) != "":
            if time.monotonic() > deadline:
                raise SafetyStop(f"after {timeout:g} s {restless}; nothing was released, the rods stay held")

    def await_go_ahead(self, confirm: Confirm) -> None:
        """Wait for the permission to release, then repeat the checks of the rods.

        The rods are checked again because they may have moved during the wait.

        Raises:
            SafetyStop: the permission was refused, or the rods are not at rest at the pose.
        """
        while (answer := confirm()) is None:
            self._look(self._settings.poll_s)
        if not answer:
            raise SafetyStop("the release was not permitted; nothing was released, the rods stay held")
        restless = self._look(0)
        if restless:
            raise SafetyStop(f"the release was permitted, but {restless}; nothing was released, the rods stay held")

    def _look(self, timeout: float) -> str:
        """Process new samples; return the reason why a release is not permitted, empty if it is permitted."""
        batches = self._device.poll(timeout)
        raise_faults(self._device.url, batches)
        _raise_if_open(self._device.url, batches)
        self.window.add(batches)
        motion = self.window.motion(self._rig)
        if motion is None:
            return "the device has not streamed a full second of samples yet"
        silent_s, limit_s = self.window.silent_s(time.monotonic()), self._device.silence_s
        if silent_s > limit_s:
            return f"the device has sent no samples for {silent_s:.1f} s (limit {limit_s:g} s)"
        reading = self._reading(*motion)
        if time.monotonic() >= self._report_at:
            self._report_at = time.monotonic() + self._settings.report_s
            self._on_reading(reading)
        return reading.restless or self._denied()

    def _denied(self) -> str:
        """Return the reason why the last STATUS does not permit a release.

        The text is empty if the device holds the rods and streams.
        """
        status = self._device.status
        if status is None:
            return "the device has not reported that its latch holds"
        if status.state is not State.STREAMING or not status.latched:
            return f"the device reported {status.state.name} instead of streaming with the latch closed"
        return ""

    def _reading(self, t: Array, theta: Array) -> RestReading:
        speed, spread = rest_motion(t, theta)
        rest = self._settings.limits.rest
        limit = rest.spread(self._rig)
        still = speed <= rest.speed and spread <= limit
        errors = np.abs(pose_error(theta, self._pose)).mean(axis=0)
        worst = float(errors[: self._rig.rods.placed].max())
        restless = ""
        arm = arm_restless(t, theta, self._rig, rest)
        if not still:
            drift = f"drifting {speed:.3f} rad/s (limit {rest.speed} rad/s)" if speed > rest.speed else ""
            shaking = f"vibrating {spread:.5f} rad rms (limit {limit:.5f} rad)" if spread > limit else ""
            restless = f"the rods still moved: {' and '.join(part for part in (drift, shaking) if part)}"
        elif worst > self._pose.tolerance:
            restless = f"the rods were {worst:.3f} rad away from the pose"
        restless = restless or arm
        return RestReading(*_placed(theta[-1], self._pose), self._pose.tolerance, speed, spread, still, restless, arm)
