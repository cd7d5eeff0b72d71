"""CAN bus (python-can): `can://socketcan/can0?bitrate=1000000`, or any other backend except slcan.

The Notifier thread of python-can ends at a bus error, so frames are received by a loop of this module.
"""

import fnmatch
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
from can.interfaces import BACKENDS

from dpr_lab.errors import DeviceLost, LinkError, LinkUrlError
from dpr_lab.transports import by_uid
from dpr_lab.transports.discover import matching_ports
from dpr_lab.transports.slcan import SlcanBus
from dpr_lab.transports.transport import Capacity, Received, Transport
from dpr_lab.transports.url import LinkUrl, seconds, whole_number
from firmware_protocol.framing import encode_frame
from firmware_protocol.messages import Frame


@dataclass(frozen=True, slots=True)
class CanSettings:
    """Settings of a CAN bus, and the number of bits that a sample takes."""

    bitrate: int = 1_000_000
    """Default bit rate, bit/s."""
    sample_bits: int = 135
    """Number of bits of an 8-byte frame with an 11-bit identifier and maximum bit stuffing."""
    slcan_sample_bits: int = 22 * 10
    """Number of bits of the same frame in slcan: a line of 22 characters, each with start and stop bit."""
    slcan_tty_baud: int = 115_200
    """Baud rate of the adapter's port. USB adapters ignore it."""
    slcan_settle_s: float = 2.0
    """Waiting time after the port is opened, s. An adapter that resets at this moment ignores the bit rate until it has
    booted."""
    send_timeout_s: float = 1.0
    """Time after which a bus that accepts no frames counts as lost, s."""
    read_at_most_s: float = 0.02
    """Maximum duration of a read on a busy bus, s. Keepalives are sent between reads."""


CAN = CanSettings()

CAN_ERR_BUSOFF = 0x40
"""Bit in the identifier of an error frame for a controller that has left the bus (linux/can/error.h)."""

# python-can raises NameError for kvaser without a driver
_NO_BUS = (can.CanError, OSError, ValueError, ImportError, NameError)


def open_can(url: LinkUrl, rig_file: Path | None) -> Transport:
    """Open a CAN bus.

    The option `bitrate` is available for all backends. The options `tty_baud` (for an adapter behind a real UART) and
    `settle_s` are available for slcan adapters. The option `uid` selects a device by its UID, or by its last digits, on
    any channel that the backend finds. If the name of the channel contains a `*`, only matching channels are tried, as
    in `can://slcan/dev/ttyACM*?uid=51d000000001`.

    Raises:
        LinkUrlError: unknown backend or option, or no channel.
        LinkError: the backend cannot open the channel, or the device is on no channel.
    """
    readers = {"bitrate": whole_number, "tty_baud": whole_number, "settle_s": seconds, "uid": by_uid.uid_digits}
    options, backend, path = url.options(readers), url.host, url.path.rstrip("/")
    channel = path if path.count("/") > 1 else path.lstrip("/")
    if backend not in BACKENDS:
        known = ", ".join(sorted(BACKENDS))
        raise LinkUrlError(f"{url.text}: unknown CAN backend {backend!r}; python-can has: {known}")

    def open_channel(name: str) -> Transport:
        return _open_slcan(url.text, name, options) if backend == "slcan" else _open_bus(url, name, options)

    if "uid" in options:
        names = matching_ports(channel) if backend == "slcan" else _matching_channels(url, channel)
        return by_uid.find(url.text, options["uid"], names, open_channel)
    if not channel:
        raise LinkUrlError(f"{url.text}: contains no channel; use for example can://socketcan/can0?bitrate=1000000")
    return open_channel(channel)


def _open_slcan(url: str, port: str, options: Mapping[str, Any]) -> SlcanBus:
    bitrate, tty_baud = options.get("bitrate", CAN.bitrate), options.get("tty_baud")
    capacities = [_bus_capacity(bitrate)]
    if tty_baud:
        capacities.append(Capacity(f"{tty_baud} baud", tty_baud, CAN.slcan_sample_bits, "a higher tty_baud"))
    # a pseudo-terminal needs no time to boot
    settle = options.get("settle_s", 0.0 if os.path.realpath(port).startswith("/dev/pts/") else CAN.slcan_settle_s)
    return SlcanBus(url, port, bitrate, tty_baud or CAN.slcan_tty_baud, settle, tuple(capacities))


def _open_bus(url: LinkUrl, channel: str, options: Mapping[str, Any]) -> "CanBus":
    bitrate = options.get("bitrate", CAN.bitrate)
    try:
        bus = can.Bus(interface=url.host, channel=channel, bitrate=bitrate, ignore_config=True)
    except _NO_BUS as error:
        remedy = f"; start it with: sudo ip link set {channel} up type can bitrate {bitrate}"
        problem = f"{url.host} cannot open {channel} at {bitrate} bit/s: {error}"
        raise LinkError(f"{url.text}: {problem}{remedy if url.host == 'socketcan' else ''}") from error
    return CanBus(url.text, bus, (_bus_capacity(bitrate),))


def _bus_capacity(bitrate: int) -> Capacity:
    return Capacity(f"a {bitrate} bit/s bus", bitrate, CAN.sample_bits, "a faster bus")


def _matching_channels(url: LinkUrl, pattern: str) -> list[str]:
    """Return the channels that match a pattern; a name without `*` is its only match."""
    if pattern and "*" not in pattern:
        return [pattern]
    try:
        configs = can.detect_available_configs(url.host)
    except _NO_BUS as error:
        raise LinkError(f"{url.text}: {url.host} cannot list its channels: {error}") from error
    return fnmatch.filter(sorted(str(config["channel"]) for config in configs), pattern or "*")


class CanBus:
    """`Transport` over one bus of python-can."""

    def __init__(self, url: str, bus: can.BusABC, capacities: tuple[Capacity, ...]) -> None:
        self.url = url
        self.errors = {"crc": 0, "framing": 0}
        self.capacities = capacities
        self._bus = bus
        self._open = True

    def send(self, frame: Frame) -> None:
        """Send one frame."""
        message = can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False)
        try:
            self._bus.send(message, timeout=CAN.send_timeout_s)
        except (can.CanError, OSError) as error:
            raise self._lost(error) from error

    def receive(self, timeout: float) -> Received:
        """Return all frames that have arrived; wait at most `timeout` s for the first frame."""
        frames: list[Frame] = []
        message = self._next(timeout)
        until = time.monotonic() + CAN.read_at_most_s
        while message is not None:
            if message.is_error_frame:
                self._note_error(message.arbitration_id)
            elif message.is_extended_id or message.is_remote_frame or message.is_fd:
                pass  # frames of other nodes on the same bus
            else:
                frames.append(Frame(message.arbitration_id, bytes(message.data)))
            message = self._next(0.0) if time.monotonic() < until else None
        return Received(time.monotonic(), tuple(frames), b"".join(map(encode_frame, frames)))

    def close(self) -> None:
        """Leave the bus."""
        if not self._open:
            return
        self._open = False
        try:
            self._bus.shutdown()
        except (can.CanError, OSError, ValueError, TypeError):
            pass  # a lost adapter need not be closed

    def _note_error(self, error_class: int) -> None:
        self.errors["framing"] += 1
        if error_class & CAN_ERR_BUSOFF:
            raise DeviceLost(
                f"{self.url}: the adapter has left the bus after too many errors (bus-off): check bit rate, termination"
                " and wiring, then connect again"
            )

    def _next(self, timeout: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout)
        except (can.CanError, OSError, TypeError, ValueError) as error:
            raise self._lost(error) from error

    def _lost(self, error: BaseException) -> DeviceLost:
        return DeviceLost(f"{self.url}: the bus is lost ({error}): check adapter, wiring and power, then connect again")
