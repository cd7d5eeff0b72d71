"""Losses by cause: messages of an idle device, and complete counts that contradict the samples."""

from pathlib import Path

from dpr_lab.acquisition.batch import Batch
from dpr_lab.acquisition.recording import Recording
from dpr_lab.rig import Rig
from dpr_lab.run import LOSS_CAUSES
from dpr_lab.storage.metadata import RunMetadata
from dpr_lab.storage.writer import RunWriter
from firmware_protocol.messages import Position
from firmware_protocol.stream import Row
from tests.acquisition.test_device import Loop, at_least, collect, streaming

HALF_RANGE = 0x8000


def test_a_turn_of_an_idle_device_contradicts_no_samples() -> None:
    """After STOP, the ticks of the device restart at 0 and reach those of the stream again."""
    loop = Loop()
    with streaming(loop) as device:
        loop.push([loop.session.sample(tick, (0, 0, 0)) for tick in range(200)])
        collect(device, at_least(199))
        device.stop()
        device.poll(0)
        loop.push(list(loop.session.positions(200, (0, HALF_RANGE, 0))))
        collect(device, lambda batches: any(isinstance(m, Position) for batch in batches for m in batch.messages))
        assert device.losses == dict.fromkeys(LOSS_CAUSES, 0)


def test_a_contradicted_position_explains_no_missing_tick(paper: Rig, tmp_path: Path) -> None:
    """Tick 2 is missing."""
    batch = Batch(0.0, b"", tuple(Row(tick, (0, 0, 0)) for tick in (0, 1, 3)), ())
    with (
        RunWriter(tmp_path / "a.mcap", RunMetadata(paper, "X1", 1000)) as writer,
        Recording(writer, {}, 1.0) as recording,
    ):
        recording.add([batch])
        recording.count_losses({"contradicted_position": 1})
        assert recording.lost == {"contradicted_position": 1, "tick_gap": 1}
