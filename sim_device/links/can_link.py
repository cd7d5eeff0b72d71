"""Transmit frames on a CAN bus."""

from collections import deque
from typing import TYPE_CHECKING

from firmware_protocol.messages import Frame
from sim_device.faults import Faults
from sim_device.links.link import HostAddress

if TYPE_CHECKING:
    import can


class CanLink:
    """Link on a python-can bus, which has its own queue."""

    def __init__(self, address: HostAddress, bus: "can.BusABC", faults: Faults) -> None:
        self.address, self.blocked = address, False
        self._bus, self._faults = bus, faults
        self._arrived: deque[can.Message] = deque()

    def receive(self) -> list[Frame]:
        """Return the frames that have arrived."""
        while (message := self._bus.recv(0.0)) is not None:
            self._arrived.append(message)
        plain = [m for m in self._arrived if not (m.is_extended_id or m.is_remote_frame or m.is_error_frame)]
        self._arrived.clear()
        return self._faults.frames([Frame(m.arbitration_id, bytes(m.data)) for m in plain])

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Send the frames on the bus; none is dropped."""
        import can

        for frame in self._faults.frames(frames):
            self._bus.send(can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False))
        return []

    def wait(self, timeout: float) -> None:
        """Wait for a frame for at most `timeout` s."""
        message = self._bus.recv(timeout)
        if message is not None:
            self._arrived.append(message)

    def bus_off(self) -> None:
        """Send an error frame with the class that SocketCAN uses for bus-off (CAN_ERR_BUSOFF)."""
        import can

        self._bus.send(can.Message(arbitration_id=0x40, is_error_frame=True, dlc=8, data=bytes(8)))

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()
