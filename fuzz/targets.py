"""Fuzz targets: one function for each reader of untrusted bytes. It asserts the properties that hold for any input.

A reader may refuse an input with its documented error. Any other exception, a wrong result, a hang, or unlimited use of
memory is a fault.
"""

import json
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

import numpy as np

from dpr_lab.configs import read_config
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.identification.model import load_model
from dpr_lab.rig import PARAMETERS, Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.inspect import info, recover, verify
from dpr_lab.storage.layout import CLOCK, EVENTS, SAMPLES, STATUS, Stored
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.writer import RunWriter
from dpr_lab.transports.slcan import LONGEST_LINE, SlcanDecoder
from firmware_protocol.device_role import DeviceSession
from firmware_protocol.errors import RemoteProtocolError
from firmware_protocol.framing import MAX_ENCODED, FrameDecoder, encode_frame
from firmware_protocol.host_role import HostSession
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import NUMBERS, RELEASE_KEY, Frame, Hello, Hold, Release, Stream, encode
from firmware_protocol.stream import SampleStream

MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Folder for temporary files, in memory if possible, because the writer synchronises each file with the disk."""
PAPER = load_rig("paper")
IDENTITY = DeviceInfo("1.0.0", "00000000000000ff", (16384, 16384, 16384), rate_max_hz=4000, rate_default_hz=100)
METADATA = RunMetadata(PAPER, "X1", 1000)
CSV_OPTIONS = (
    ImportOptions(),
    ImportOptions(angles="relative", zero="hanging", unit="deg", time_unit="ms"),
    ImportOptions(unit="counts"),
)


def frames(data: bytes) -> None:
    """Test the decoder of the serial framing.

    The division of the bytes into blocks has no effect, and the bytes contain every decoded frame.
    """
    whole, cut = FrameDecoder(), FrameDecoder()
    decoded = whole.feed(data)
    split = data[0] if data else 0
    assert cut.feed(data[:split]) + cut.feed(data[split:]) == decoded
    assert (cut.crc_errors, cut.framing_errors) == (whole.crc_errors, whole.framing_errors)
    for frame in decoded:
        assert encode_frame(frame)[:-1] in data
    assert len(whole._rest) <= MAX_ENCODED


def slcan(data: bytes) -> None:
    """Test the decoder of the lines of a CAN adapter."""
    whole, cut = SlcanDecoder(), SlcanDecoder()
    result = whole.feed(data)
    at = data[0] if data else 0
    if max(map(len, data.replace(b"\a", b"\r").split(b"\r")), default=0) <= LONGEST_LINE:
        assert cut.feed(data[:at]) + cut.feed(data[at:]) == result
    for frame in result:
        assert len(frame.data) <= 8
        assert frame.id < 1 << 11
    assert len(whole._rest) <= LONGEST_LINE


def session(data: bytes) -> None:
    """Test both sides of the protocol: no input causes an error, and only RELEASE with its key opens the latch."""
    device, host, stream = DeviceSession(IDENTITY), HostSession(), SampleStream()
    for number, opening in enumerate((Hello(1), Hold(2), Stream(3, 1000))):
        device.receive(encode(opening), 0.1 * number)
    host.hello(0.0)
    tick = -1
    for number, frame in enumerate(_sliced(data)):
        latched = device.latched
        for answer in device.receive(frame, 0.3).frames:
            assert len(answer.data) <= 8
        if latched and not device.latched:
            assert frame.number == NUMBERS[Release]
            assert frame.data[1:] == RELEASE_KEY.to_bytes(2, "little")
        with suppress(RemoteProtocolError):
            message = host.receive(frame)
            row = stream.feed(message) if message is not None else None
            assert row is None or row.tick > tick
            tick = tick if row is None else row.tick
        host.due(0.01 * number)


def _sliced(data: bytes) -> list[Frame]:
    """Interpret bytes as a sequence of frames: identifier, length, data."""
    sliced: list[Frame] = []
    while len(data) >= 2:
        length = data[1] % 9
        sliced.append(Frame(64 | data[0] & 63, data[2 : 2 + length]))
        data = data[2 + length :]
    return sliced


def run_file(data: bytes) -> None:
    """Test the reader of run files with arbitrary bytes."""
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        path = Path(folder) / "a.mcap"
        path.write_bytes(data)
        assert not verify(path).ok  # there is no hash file
        with suppress(RunError):
            json.dumps(asdict(info(path)))
        with suppress(RunError):
            _check_run(load_run(path))


def run_content(data: bytes) -> None:
    """Test the reader of run files with a file that has correct CRCs and digests, but arbitrary messages.

    Each line is one message: the first byte selects the channel or a truncated file, the other bytes are the content.
    """
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        path = Path(folder) / "a.mcap"
        writer = RunWriter(path, METADATA)
        ends = _write_lines(writer, data.split(b"\n"))
        writer.finish(RunSummary(release_tick=0))
        if ends:
            content = path.read_bytes()
            path.write_bytes(content[: content.index(b"complete") - 64])
        with suppress(RunError):
            json.dumps(asdict(info(path)))
        with suppress(RunError):
            _check_run(load_run(path, verify=False))
        with suppress(RunError):
            assert recover(path, Path(folder) / "b.mcap") > 0


def _write_lines(writer: RunWriter, lines: list[bytes]) -> bool:
    """Write lines as messages. Return True if a line requests a file without its end."""
    topics, cut = (SAMPLES, SAMPLES, SAMPLES, EVENTS, CLOCK, STATUS), False
    for at, line in enumerate(lines):
        if line[:1] == b"E":
            cut = True
        elif line:
            writer.copy([Stored(topics[line[0] % len(topics)], at, at, line[1:])])
    return cut


def table(data: bytes) -> None:
    """Test the import of a table."""
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        path = Path(folder) / "a.csv"
        path.write_bytes(data)
        for options in CSV_OPTIONS:
            with suppress(RunError):
                _check_run(import_csv(path, PAPER, options))
        with suppress(RunError):
            _check_run(import_csv(path, PAPER, CSV_OPTIONS[0], Path(folder) / "a.mcap"))


def _check_run(run: Run) -> None:
    assert run.theta.shape == (len(run.t), 3)
    assert np.isfinite(run.t).all()
    assert np.isfinite(run.theta).all()
    assert (np.diff(run.t) > 0).all()
    assert run.rate_hz > 0


def rig(data: bytes) -> None:
    """Test the reader of rig files."""
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        path = Path(folder) / "a.toml"
        path.write_bytes(data)
        with suppress(ConfigError):
            read = read_config(path, Rig)
            assert np.isfinite(read.nominal).all()
            assert read.nominal.shape == (len(PARAMETERS),)
            assert np.isfinite(read.theta([1, 2, 3])).all()


def model(data: bytes) -> None:
    """Test the reader of identified models."""
    with tempfile.TemporaryDirectory(dir=MEMORY) as folder:
        path = Path(folder) / "a.json"
        path.write_bytes(data)
        with suppress(RunError):
            json.loads(load_model(path).model_dump_json())


TARGETS: dict[str, Callable[[bytes], None]] = {
    "frames": frames,
    "slcan": slcan,
    "session": session,
    "run_file": run_file,
    "run_content": run_content,
    "table": table,
    "rig": rig,
    "model": model,
}
"""Target of each name. `corpus/NAME` contains the inputs from which its search starts."""
