"""A conforming device passes the conformance test over its port; each deviation of another device is reported."""

from dataclasses import replace

import pytest

from dpr_lab.acquisition.conformance import ConformanceSettings, conformity, refuse_with_rods, sample_rate
from dpr_lab.errors import DprError
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Received
from firmware_protocol.messages import Nak, Status, decode, encode
from tests.thinned import thinned

PATIENT = ConformanceSettings(patience_s=60.0, rate_off=0.5, reports_hz=(1.0, 30.0))


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("firmware", thinned(["python", "c"], 2))
def test_the_reference_devices_conform(simulated, firmware: str) -> None:
    """The core in C without drives is also in the sketch of `tests/firmware_c/test_c_arduino.py`, which conforms."""
    link = open_transport(simulated(clock="realtime", firmware=firmware).url)
    try:
        result = list(conformity(link, PATIENT))
    finally:
        link.close()
    assert [(one.what, one.message) for one in result if not one.ok] == []
    assert len(result) >= 15
    assert result[-3].what == "the sample rate is correct"


@pytest.mark.parametrize("rate_hz", [500.0, 490.0, 510.0])
def test_samples_that_wait_for_a_busy_host_do_not_change_the_sample_rate(rate_hz: float) -> None:
    sent = [tick / rate_hz for tick in range(1000)]
    busy = [(0.0, 0.06), (0.7, 0.8), (1.9, 2.1)]
    arrived = [max([instant, *(end for begin, end in busy if begin <= instant < end)]) for instant in sent]
    samples = [(instant, (65000 + tick) & 0xFFFF) for tick, instant in enumerate(arrived)]
    assert sample_rate(samples, 500) == pytest.approx(rate_hz, rel=1e-6)


class Otherwise:
    """Link to a real device that changes some of the messages."""

    def __init__(self, inner, change) -> None:
        self.inner, self.change = inner, change

    def __getattr__(self, name: str):
        return getattr(self.inner, name)

    def receive(self, timeout: float) -> Received:
        came = self.inner.receive(timeout)
        return replace(came, frames=tuple(encode(self.change(decode(f)), f.node) for f in came.frames))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_each_deviation_of_a_device_from_the_protocol_is_named(simulated) -> None:
    def change(message):
        if isinstance(message, Nak):
            return replace(message, code=type(message.code).BAD_VALUE)
        return replace(message, latched=True) if isinstance(message, Status) else message

    link = Otherwise(open_transport(simulated(clock="realtime").url), change)
    try:
        result = {one.what: one for one in conformity(link, PATIENT)}  # pyright: ignore[reportArgumentType]
    finally:
        link.close()
    refused = result["commands refused in IDLE"]
    assert not refused.ok
    assert "step" in refused.message
    assert not result["complete run: hold, stream, release, stop"].ok
    assert "latched True" in result["complete run: hold, stream, release, stop"].message


def test_it_asks_for_the_rods_to_be_off() -> None:
    refuse_with_rods(True)
    with pytest.raises(DprError, match="--rods-off"):
        refuse_with_rods(False)
