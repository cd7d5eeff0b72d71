"""Open a link by its name on the command line."""

import math
from collections.abc import Callable

from dpr_lab.errors import LinkError
from sim_device.faults import Faults
from sim_device.links.byte_link import ByteLink, Framing, SerialCodec
from sim_device.links.can_link import CanLink
from sim_device.links.link import LIMITS, DeviceLink, HostAddress
from sim_device.links.pty_port import PtyPort
from sim_device.links.slcan import BITRATES, SlcanCodec
from sim_device.links.tcp_port import TcpServerPort


def open_link(
    name: str,
    baud: int | None = None,
    faults: Faults | None = None,
    lossless: bool = False,
    framing: Framing = SerialCodec,
) -> DeviceLink:
    """Open a link by its name.

    Args:
        name: `pty`, `slcan`, `tcp:PORT` or `virtual:CHANNEL`
        baud: bit rate, bit/s; None: 921600 for a serial port, 1000000 for a CAN bus
        faults: transmission faults
        lossless: whether the transmit queue is unlimited, so that no data are dropped; for a device that waits while
            the link is blocked
        framing: function that creates the converter between frames and the bytes of a serial line

    Raises:
        LinkError: unknown link, or a link that cannot be opened.
    """
    kind, _, where = name.partition(":")
    if kind not in LINKS:
        raise LinkError(f"{name}: unknown kind of link {kind!r} (available: pty, slcan, tcp:PORT, virtual:CHANNEL)")
    return LINKS[kind](where, baud, faults or Faults(), math.inf if lossless else LIMITS.queue_bytes, framing)


def _pty(where: str, baud: int | None, faults: Faults, queue_bytes: float, framing: Framing) -> DeviceLink:
    baud = baud or 921_600
    port = PtyPort(baud)
    host = HostAddress(f"serial://{port.path}?baud={baud}", LIMITS.carried_hz(baud, LIMITS.serial_sample_bits))
    return ByteLink(host, port, framing, faults, queue_bytes)


def _tcp(where: str, baud: int | None, faults: Faults, queue_bytes: float, framing: Framing) -> DeviceLink:
    port = TcpServerPort(where)
    host = HostAddress(f"socket://127.0.0.1:{port.number}", LIMITS.rate_max_hz)
    return ByteLink(host, port, framing, faults, queue_bytes)


def _slcan(where: str, baud: int | None, faults: Faults, queue_bytes: float, framing: Framing) -> DeviceLink:
    bitrate = _can_bitrate(baud)
    _refuse_byte_faults(faults)
    port = PtyPort(None)
    url = f"can://slcan{port.path}?bitrate={bitrate}"
    host = HostAddress(url, LIMITS.carried_hz(bitrate, LIMITS.can_sample_bits), LIMITS.slcan_fast_samples_hz)
    return ByteLink(host, port, lambda: SlcanCodec(bitrate), faults, queue_bytes)


def _virtual(where: str, baud: int | None, faults: Faults, queue_bytes: float, framing: Framing) -> DeviceLink:
    import can

    bitrate = _can_bitrate(baud)
    _refuse_byte_faults(faults)
    channel = where or "dpr"
    url = f"can://virtual/{channel}?bitrate={bitrate}"
    host = HostAddress(url, LIMITS.carried_hz(bitrate, LIMITS.can_sample_bits))
    return CanLink(host, can.Bus(channel, interface="virtual"), faults)


LINKS: dict[str, Callable[[str, int | None, Faults, float, Framing], DeviceLink]] = {
    "pty": _pty,
    "slcan": _slcan,
    "tcp": _tcp,
    "virtual": _virtual,
}
"""Function that opens each kind of link. `virtual` is the in-process bus of python-can, whose host is in the same
process."""


def _can_bitrate(baud: int | None) -> int:
    bitrate = baud or 1_000_000
    if bitrate not in BITRATES:
        raise LinkError(f"CAN does not run at {bitrate} bit/s: choose one of {', '.join(map(str, BITRATES))}")
    return bitrate


def _refuse_byte_faults(faults: Faults) -> None:
    if faults.strikes_bytes():
        raise LinkError(
            "flip, garbage and truncate damage bytes, which a CAN controller never passes on: use pty or tcp, or drop"
        )
