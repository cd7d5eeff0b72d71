"""Errors of a device: a failed command, or no answer."""

from collections.abc import Sequence

from dpr_lab.errors import DeviceFault, DprError, LinkError, LinkTimeout, MismatchError
from dpr_lab.transports.transport import Capacity
from firmware_protocol.errors import CommandRefused, CommandUnanswered, RemoteProtocolError, VersionMismatch
from firmware_protocol.messages import NakCode, Status, explain


def translated(url: str, error: RemoteProtocolError, status: Status | None) -> DprError:
    """Convert the protocol error of a command to an error for the operator.

    If the device refused the command because of a fault, the message names the fault.

    Args:
        url: link of the device
        error: error of the protocol
        status: last status of the device; None if none has arrived
    """
    kinds = {VersionMismatch: MismatchError, CommandRefused: DeviceFault, CommandUnanswered: LinkTimeout}
    sentence = f"{url}: {error}"
    if isinstance(error, CommandRefused) and error.code == NakCode.FAULTED and status is not None:
        sentence += f" The fault is: {' '.join(explain(status.fault))}"
    elif isinstance(error, CommandUnanswered):
        sentence += ": check its cable and power, then connect again"
    return kinds.get(type(error), LinkError)(sentence)


def no_answer(url: str, timeout: float, capacities: Sequence[Capacity], invalid_bytes: int) -> LinkTimeout:
    """Create the error of a device that does not answer.

    Args:
        url: link of the device
        timeout: waiting time, s
        capacities: capacities of the link; their names state its speed
        invalid_bytes: number of bytes received without a valid frame; 0 if a valid frame arrived
    """
    speeds = " and ".join(capacity.name for capacity in capacities)
    if invalid_bytes:
        return LinkTimeout(
            f"{url}: {invalid_bytes} bytes arrived, but no valid frame: {speeds or 'the speed'} is probably wrong; give"
            " the speed of the device's firmware in the link (?baud=... or ?bitrate=...)"
        )
    hint = f", and that the device is set to {speeds}" if speeds else ""
    return LinkTimeout(
        f"{url}: opened, but no DPR device answered within {timeout:g} s: check its power and wiring{hint}"
    )
