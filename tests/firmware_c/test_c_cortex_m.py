"""C core on a Cortex-M in QEMU, with the real driver at the other end of a pseudo-terminal."""

import ctypes
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import firmware_protocol
from dpr_lab.acquisition.capture import Captured, CaptureOptions, capture
from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.settings import CaptureSettings
from dpr_lab.errors import DprError, LinkTimeout
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from firmware_protocol.messages import State, Status
from firmware_protocol.session import LEASE_S

pytestmark = pytest.mark.slow

ATTEMPTS = 8
STARVED = ("heard nothing from the host", "reported HOLDING instead of streaming")
"""What a lease that has ended looks like: by the device's event, or by its state if that is seen first."""
ANY_PACE = CaptureSettings(slowest_pace=0.0)
"""On a busy machine the emulated timer may run at a hundredth of its rate."""

PORT = Path(firmware_protocol.__file__).parent / "c" / "ports" / "mps2_an385"


class Rods(ctypes.Structure):
    _fields_ = (("theta", ctypes.c_float * 2), ("omega", ctypes.c_float * 2), ("held", ctypes.c_bool))


@pytest.fixture(scope="module")
def swing(tmp_path_factory) -> Callable[[int, int, int], np.ndarray]:
    """What the port's rods read at each tick from the release on, computed on this machine from the same source."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("cc is not installed")
    target = tmp_path_factory.mktemp("rods") / "librods.so"
    flags = ["-std=c99", "-O1", "-ffp-contract=off", "-fPIC", "-shared"]
    subprocess.run([compiler, *flags, "-o", target, PORT / "rods.c"], check=True, timeout=400)
    library = ctypes.CDLL(str(target))
    library.rods_step.argtypes = (ctypes.c_void_p, ctypes.c_float)

    def counts(pose: int, rate_hz: int, samples: int) -> np.ndarray:
        rods, read = Rods(), (ctypes.c_int32 * 3)()
        library.rods_place(ctypes.byref(rods), ctypes.c_uint8(pose))
        library.rods_let_go(ctypes.byref(rods))
        rows = []
        for _ in range(samples):
            library.rods_read(ctypes.byref(rods), read)
            rows.append(list(read))
            library.rods_step(ctypes.byref(rods), ctypes.c_float(np.float32(1) / np.float32(rate_hz)))
        return np.array(rows)

    return counts


@pytest.fixture
def device(board) -> Iterator[Device]:
    with connected(board.url) as device:
        yield device


def connected(url: str) -> Device:
    """QEMU looks only once a second whether somebody has opened its terminal."""
    device = Device(open_transport(url))
    try:
        device.connect(timeout=20.0)
    except LinkTimeout:
        device.close()
        raise
    return device


def captured_at_last(url: str, *asked) -> tuple[str, Captured]:
    """The device's name and a capture; a machine under load may leave QEMU without its host for longer than the lease.

    The device then stops, as required, at any point of a recording.
    """
    for attempt in range(ATTEMPTS):
        with connected(url) as device:
            try:
                return device.info.uid, capture(device, *asked, confirm=lambda: True, settings=ANY_PACE)
            except DprError as error:
                if not any(words in str(error) for words in STARVED) or attempt == ATTEMPTS - 1:
                    raise
    raise AssertionError


@pytest.mark.parametrize(
    ("pose", "rate_hz"),
    [("X1", 1000), pytest.param("X2", 1000, marks=pytest.mark.long), pytest.param("X3", 4000, marks=pytest.mark.long)],
)
def test_a_capture_has_every_count_as_it_was_read(pose, rate_hz, board, swing, paper, tmp_path):
    options = CaptureOptions(rate_hz=rate_hz, duration=1.0, rest_timeout=60.0)
    uid, captured = captured_at_last(board.url, paper, pose, options, tmp_path)
    # An emulated timer is no crystal: a busy computer slows it down, and not evenly.
    wrong = {check.name for check in captured.quality.checks if not check.ok}
    assert wrong <= {"clock", "clock_fit"}, captured.quality.sentence
    assert sum(captured.lost.values()) == 0
    counts = load_run(captured.run_file).swing.counts
    assert counts is not None
    assert len(counts) == rate_hz + 1
    assert np.array_equal(counts, swing(1 + list(paper.poses).index(pose), rate_hz, len(counts)))
    assert uid == "00a385000000dead"


def test_a_driver_that_goes_away_leaves_the_rods_held(board, device):
    device.hold(1)
    device.stream(1000)
    device.close()
    time.sleep(3 * LEASE_S)  # a driver that came back within the lease would find it streaming
    with connected(board.url) as again:
        status, end = None, time.monotonic() + 60.0
        while (status is None or status.state is State.STREAMING) and time.monotonic() < end:
            result = [m for batch in again.poll(5.0) for m in batch.messages if isinstance(m, Status)]
            status = result[-1] if result else status
        assert status is not None
        assert (status.state, status.latched) == (State.HOLDING, True)
