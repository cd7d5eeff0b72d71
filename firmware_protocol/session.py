"""States of a device, and the table of its transitions.

`device_role.DeviceSession` uses this table. `host_role.HostSession` is the other side of the protocol. The latch holds
in HOLDING and STREAMING, and is open in IDLE and RELEASED; FAULT does not change it. Only RELEASE leads from a state
with a held latch to a state with an open one: no stop, fault or silence releases the rods.
"""

from enum import Enum, auto

from firmware_protocol.messages import State


class Trigger(Enum):
    """Causes of transitions."""

    HOLD = auto()
    STREAM = auto()
    RELEASE = auto()
    STOP = auto()
    CLEAR_LATCHED = auto()
    """CLEAR_FAULT while the latch holds."""
    CLEAR_OPEN = auto()
    """CLEAR_FAULT while the latch is open."""
    LEASE_LOST = auto()
    FAULT = auto()


TRANSITIONS: dict[tuple[State, Trigger], State] = {
    (State.IDLE, Trigger.HOLD): State.HOLDING,
    (State.IDLE, Trigger.STOP): State.IDLE,
    (State.HOLDING, Trigger.HOLD): State.HOLDING,
    (State.HOLDING, Trigger.STREAM): State.STREAMING,
    (State.HOLDING, Trigger.STOP): State.HOLDING,
    (State.STREAMING, Trigger.RELEASE): State.RELEASED,
    (State.STREAMING, Trigger.STOP): State.HOLDING,
    (State.STREAMING, Trigger.LEASE_LOST): State.HOLDING,
    (State.RELEASED, Trigger.STOP): State.IDLE,
    (State.RELEASED, Trigger.LEASE_LOST): State.IDLE,
    (State.FAULT, Trigger.CLEAR_LATCHED): State.HOLDING,
    (State.FAULT, Trigger.CLEAR_OPEN): State.IDLE,
    (State.FAULT, Trigger.STOP): State.FAULT,
    **{(state, Trigger.FAULT): State.FAULT for state in State},
}
"""Next state, by state and trigger. All other combinations are refused."""

LATCHED: dict[State, bool] = {
    State.IDLE: False,
    State.HOLDING: True,
    State.STREAMING: True,
    State.RELEASED: False,
}
"""Whether the latch holds, by state. FAULT is missing, because it leaves the latch unchanged."""

STREAMS = (State.STREAMING, State.RELEASED)
"""States in which samples are sent."""

LEASE_S = 0.5
"""Maximum silence of a host, s. After it, a device stops streaming."""
