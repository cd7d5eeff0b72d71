"""Losses by cause: messages of an idle device, and complete counts that contradict the samples."""

from dpr_lab.acquisition.device import Device
from firmware_protocol.messages import Position
from tests.acquisition.test_device import Loop, at_least, collect

HALF_RANGE = 0x8000


def test_a_turn_of_an_idle_device_contradicts_no_samples() -> None:
    """After STOP, the ticks of the device restart at 0 and reach those of the stream again."""
    loop = Loop()
    with Device(loop) as device:
        device.connect()
        device.hold()
        device.stream(1000)
        loop.push(list(loop.session.positions(0, (0, 0, 0))))
        loop.push([loop.session.sample(tick, (0, 0, 0)) for tick in range(200)])
        collect(device, at_least(199))
        device.stop()
        device.poll(0)
        loop.push(list(loop.session.positions(200, (0, HALF_RANGE, 0))))
        collect(device, lambda batches: any(isinstance(m, Position) for batch in batches for m in batch.messages))
        assert device.losses["contradicted"] == 0
