"""Capture that the screen controls: reports progress, and receives the release command and cancel requests."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dpr_lab.acquisition.capture import Progress, capture
from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.swing import Released, SwingReading
from dpr_lab.errors import SafetyStop
from dpr_lab.rig import Rig
from dpr_lab.tui.recorder.mailbox import Inbox, Outbox
from dpr_lab.tui.recorder.messages import AttemptFinished, AttemptSeen, CaptureAttempt, GoAheadAsked
from dpr_lab.tui.recorder.settings import SETTINGS


def carry_out(
    order: CaptureAttempt, device: Device, rig: Rig, runs: Path, inbox: Inbox, outbox: Outbox
) -> AttemptFinished:
    """Execute a capture command; see `capture` for the errors."""
    guided = _GuidedCapture(order, device, inbox, outbox)
    captured = capture(device, rig, order.pose, order.options, runs, guided.on_progress, guided.confirm)
    return AttemptFinished(order.attempt, captured, device.clock()[0])


def lost_since(before: Mapping[str, int], device: Device) -> dict[str, int]:
    """Return the number of samples that were lost since the counts `before`, by cause.

    A device counts lost torques only while it streams.
    """
    return {cause: count - before.get(cause, 0) for cause, count in device.losses.items()}


class _GuidedCapture:
    """Callbacks of a capture, which report progress and request the release command."""

    def __init__(self, order: CaptureAttempt, device: Device, inbox: Inbox, outbox: Outbox) -> None:
        self._order, self._device, self._inbox, self._outbox = order, device, inbox, outbox
        self._lost_before = device.losses
        self._asked_at: float | None = None
        self._released = False
        self._unsent: list[SwingReading] = []

    def on_progress(self, progress: Progress) -> None:
        """Send a report of the progress.

        Raises:
            SafetyStop: the operator cancelled the attempt, or the screen has ended.
        """
        self._released = self._released or isinstance(progress, Released)
        self._end_if_wanted()
        if isinstance(progress, SwingReading):
            self._unsent.append(_thinned(progress))
            progress = _joined(self._unsent)
        status = self._device.status
        latched = None if status is None else status.latched
        lost = lost_since(self._lost_before, self._device)
        progress_seen = AttemptSeen(self._order.attempt, progress, latched, self._device.heard_at, lost)
        if self._outbox.add_if_read(progress_seen):
            self._unsent.clear()

    def confirm(self) -> bool | None:
        """Return True if the rods may be released now, otherwise None.

        A release command permits the release under three conditions: it is recent, it was sent after the request, and
        it names this attempt and this pose.
        """
        self._end_if_wanted()
        if self._asked_at is None:
            self._asked_at = time.monotonic()
            self._outbox.add(GoAheadAsked(self._order.attempt))
        order = self._inbox.take_go_ahead()
        if order is None or (order.attempt, order.pose) != (self._order.attempt, self._order.pose):
            return None
        fresh = max(self._asked_at, time.monotonic() - SETTINGS.go_ahead_lasts_s) <= order.given_at
        return True if fresh else None

    def _end_if_wanted(self) -> None:
        reason = self._inbox.why_to_end(self._order.attempt)
        if reason:
            raise SafetyStop(reason if self._released else f"{reason}: nothing was released, the rods stay held")


def _thinned(recorded: SwingReading) -> SwingReading:
    (t, theta), inputs = recorded.fresh, recorded.inputs
    step = max(1, round(1 / (SETTINGS.trace_hz * float(np.median(np.diff(t)))))) if len(t) > 1 else 1
    return replace(recorded, fresh=(t[::step], theta[::step]), inputs=None if inputs is None else inputs[::step])


def _joined(readings: Sequence[SwingReading]) -> SwingReading:
    """Return the newest reading, extended by the points of unsent earlier readings."""
    t, theta = zip(*(reading.fresh for reading in readings), strict=True)
    inputs = [reading.inputs for reading in readings if reading.inputs is not None]
    fresh = np.concatenate(t), np.concatenate(theta)
    return replace(readings[-1], fresh=fresh, inputs=np.concatenate(inputs) if inputs else None)
