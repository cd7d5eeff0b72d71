"""Python interface of the reference firmware.

Inputs are frames, times and readings; outputs are frames and actions.
"""

import ctypes
import struct
from ctypes import POINTER, Structure, byref, c_bool, c_char_p, c_int32, c_size_t, c_uint8, c_uint16, c_uint32, c_uint64
from functools import cache

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import DEVICE_NODE, MAX_DATA, Frame, State, TorqueKind
from sim_device.firmware.c_library import library_path

FRAMES = 2048
"""Maximum number of frames that the library stores until they are fetched (`DPR_HOST_FRAMES`)."""

READINGS = FRAMES // 16
"""Maximum number of readings per poll, so that their frames can be stored."""

SHORTEST_LINE = 5
"""Number of bytes of the shortest frame on a byte stream."""

_FRAME = struct.Struct(f"=HB{MAX_DATA}sx")
_READING = np.dtype(
    [
        ("tick", np.int32),
        ("counts", np.int32, 3),
        ("torques", np.int16, (len(TorqueKind), 2)),
        ("inputs", np.int32, len(TorqueKind)),
    ]
)


class _Frame(Structure):
    _fields_ = (("id", c_uint16), ("length", c_uint8), ("data", c_uint8 * MAX_DATA))


class _Identity(Structure):
    _fields_ = (
        ("uid", c_uint64),
        ("counts_per_rev", c_uint32 * 3),
        ("rate_max_hz", c_uint16),
        ("rate_default_hz", c_uint16),
        ("firmware", c_uint8 * 3),
        ("node", c_uint8),
        ("simulated_time", c_bool),
        ("torques", c_bool * len(TorqueKind)),
        ("torque_unit_uNm", c_uint32),
        ("inputs", c_bool * len(TorqueKind)),
        ("input_quantity", c_uint8),
        ("input_unit", c_uint32),
    )


class HardwareActions(Structure):
    """Actions of the firmware on latch and timer since the last call."""

    release_tick: int
    rate_hz: int
    pose: int
    hold: bool
    release: bool
    start_ticks: bool
    _fields_ = (
        ("release_tick", c_uint32),
        ("rate_hz", c_uint16),
        ("pose", c_uint8),
        ("hold", c_bool),
        ("release", c_bool),
        ("start_ticks", c_bool),
    )


_PROTOTYPES = {
    "dpr_host_size": (c_size_t,),
    "dpr_host_decoder_size": (c_size_t,),
    "dpr_host_start": (None, c_char_p, POINTER(_Identity)),
    "dpr_host_claim": (None, c_char_p, c_uint8, c_uint32),
    "dpr_host_receive": (None, c_char_p, POINTER(_Frame), c_uint32, c_uint32, c_uint16),
    "dpr_host_poll": (None, c_char_p, c_uint32, POINTER(c_int32), c_size_t),
    "dpr_host_set_fault": (None, c_char_p, c_uint8),
    "dpr_host_note_dropped": (None, c_char_p, c_uint16),
    "dpr_host_take": (c_size_t, c_char_p, c_char_p),
    "dpr_host_actions": (HardwareActions, c_char_p),
    "dpr_host_state": (c_uint8, c_char_p),
    "dpr_host_latched": (c_bool, c_char_p),
    "dpr_host_next_tick": (c_uint32, c_char_p),
    "dpr_host_decode": (c_size_t, c_char_p, c_char_p, c_size_t, c_char_p),
    "dpr_host_errors": (None, c_char_p, POINTER(c_uint32), POINTER(c_uint32)),
    "dpr_frame_encode": (c_size_t, POINTER(_Frame), c_char_p),
}


@cache
def load() -> ctypes.PyDLL:
    """Load the library, which is compiled if necessary.

    Raises:
        ConfigError: the library cannot be compiled.
    """
    # the interpreter lock is not released, because the calls are short and a busy thread could then keep it for some
    # time
    library = ctypes.PyDLL(str(library_path()))
    for name, (result, *arguments) in _PROTOTYPES.items():
        function = library[name]
        function.restype, function.argtypes = result, arguments
        setattr(library, name, function)
    return library


class Firmware:
    """Firmware of one board; the caller supplies times, ticks and readings.

    Raises:
        ConfigError: the firmware cannot be built, because there is no compiler.
    """

    def __init__(self, info: DeviceInfo, node: int = DEVICE_NODE, library: ctypes.PyDLL | None = None) -> None:
        self._library = library or load()
        self._host = ctypes.create_string_buffer(self._library.dpr_host_size())
        self._frames = ctypes.create_string_buffer(FRAMES * _FRAME.size)
        self._kind_indices = [list(TorqueKind).index(kind) for kind in info.torque_kinds]
        self._inputs = [list(TorqueKind).index(kind) for kind in info.input_kinds]
        self._library.dpr_host_start(self._host, byref(_identity(info, node)))
        self._library.dpr_host_claim(self._host, info.major, info.schema_hash)

    @property
    def state(self) -> State:
        """State of the firmware."""
        return State(self._library.dpr_host_state(self._host))

    @property
    def latched(self) -> bool:
        """Whether the firmware holds the latch."""
        return self._library.dpr_host_latched(self._host)

    @property
    def next_tick(self) -> int:
        """Tick of the next expected reading."""
        return self._library.dpr_host_next_tick(self._host)

    def receive(self, frame: Frame, millis: int, ticks: float) -> list[Frame]:
        """Process a frame and return the answers.

        The time of arrival is given in ms, and in ticks with fraction.
        """
        tick, fraction = divmod(ticks, 1.0)
        time = (millis & 0xFFFFFFFF, int(tick) & 0xFFFFFFFF, min(int(fraction * 65536), 65535))
        self._library.dpr_host_receive(self._host, byref(_packed(frame)), *time)
        return self._taken()

    def poll(
        self,
        millis: int,
        readings: NDArray[np.int64] | None = None,
        torques: NDArray[np.int64] | None = None,
        inputs: NDArray[np.int64] | None = None,
    ) -> list[Frame]:
        """Check lease, fault and readings, and return the messages to send.

        Args:
            millis: current time, ms
            readings: (n, 4) tick and three counters
            torques: (n, kinds, 2) torques as multiples of the unit in the identity, for the kinds in the identity
            inputs: (n, kinds) inputs of the arm's drive, likewise
        """
        rows = self._rows(readings, torques, inputs)
        frames: list[Frame] = []
        for first in range(0, max(len(rows), 1), READINGS):
            batch = rows[first : first + READINGS]
            pointer = batch.ctypes.data_as(POINTER(c_int32))
            self._library.dpr_host_poll(self._host, millis & 0xFFFFFFFF, pointer, len(batch))
            frames += self._taken()
        return frames

    def _rows(
        self,
        readings: NDArray[np.int64] | None,
        torques: NDArray[np.int64] | None,
        inputs: NDArray[np.int64] | None,
    ) -> NDArray[np.void]:
        """Return the readings as an array (n,) of `dpr_reading_t`."""
        rows = np.zeros(0 if readings is None else len(readings), _READING)
        if readings is not None:
            rows["tick"], rows["counts"] = readings[:, 0].astype(np.int32), readings[:, 1:].astype(np.int32)
        if torques is not None and torques.size:
            rows["torques"][:, self._kind_indices] = torques.clip(-0x8000, 0x7FFF)
        if inputs is not None and inputs.size:
            rows["inputs"][:, self._inputs] = inputs.clip(-(1 << 31), (1 << 31) - 1)
        return rows

    def hardware_actions(self) -> HardwareActions:
        """Return the actions on latch and timer since the last call."""
        return self._library.dpr_host_actions(self._host)

    def set_fault(self, fault: int) -> None:
        """Set the fault of the hardware; 0 means none."""
        self._library.dpr_host_set_fault(self._host, fault)

    def note_dropped(self, samples: int) -> None:
        """Report samples for which the link had no room."""
        self._library.dpr_host_note_dropped(self._host, samples & 0xFFFF)

    def _taken(self) -> list[Frame]:
        return _unpacked(self._frames, self._library.dpr_host_take(self._host, self._frames))


class CFraming:
    """Framing for a UART with the encoder and decoder of the firmware."""

    def __init__(self, library: ctypes.PyDLL | None = None) -> None:
        self._library = library or load()
        self._decoder = ctypes.create_string_buffer(self._library.dpr_host_decoder_size())
        self._line = ctypes.create_string_buffer(64)

    def encode(self, frame: Frame) -> bytes:
        """Return the bytes of a frame: COBS with delimiter."""
        length = self._library.dpr_frame_encode(byref(_packed(frame)), self._line)
        return self._line.raw[:length]

    def decode(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Return the undamaged frames in received bytes; the second value, an immediate answer, is always empty."""
        frames = ctypes.create_string_buffer((len(data) // SHORTEST_LINE + 2) * _FRAME.size)
        return _unpacked(frames, self._library.dpr_host_decode(self._decoder, data, len(data), frames)), b""

    @property
    def errors(self) -> dict[str, int]:
        """Number of damaged packets so far, by cause."""
        crc, framing = c_uint32(), c_uint32()
        self._library.dpr_host_errors(self._decoder, byref(crc), byref(framing))
        return {"crc": crc.value, "framing": framing.value}


def _identity(info: DeviceInfo, node: int) -> _Identity:
    return _Identity(
        int(info.uid, 16),
        info.counts_per_rev,
        info.rate_max_hz,
        info.rate_default_hz,
        tuple(map(int, info.firmware.split("."))),
        node,
        info.simulated_time,
        tuple(kind in info.torque_kinds for kind in TorqueKind),
        info.torque_unit_uNm,
        tuple(kind in info.input_kinds for kind in TorqueKind),
        info.input_quantity or 0,
        info.input_unit,
    )


def _packed(frame: Frame) -> _Frame:
    return _Frame.from_buffer_copy(_FRAME.pack(frame.id, len(frame.data), frame.data))


def _unpacked(frames: ctypes.Array[ctypes.c_char], count: int) -> list[Frame]:
    rows = _FRAME.iter_unpack(memoryview(frames)[: count * _FRAME.size])
    return [Frame(identifier, data[:length]) for identifier, length, data in rows]
