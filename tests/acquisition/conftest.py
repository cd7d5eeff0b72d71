"""Fixtures of a simulated device for captures."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pytest

from dpr_lab.acquisition.device import Device
from dpr_lab.transports import open_transport
from firmware_protocol.messages import State, Status

Bench = Callable[..., AbstractContextManager[tuple[Device, Any]]]


@pytest.fixture
def bench(simulated, spy_on) -> Bench:
    """Connected simulated device, with a recorder of the messages on its link."""

    @contextmanager
    def connected(lose_every: int = 0, **options: Any) -> Iterator[tuple[Device, Any]]:
        spy = spy_on(open_transport(simulated(**options).url), lose_every)
        with Device(spy) as device:
            device.connect()
            yield device, spy

    return connected


@pytest.fixture(scope="session")
def settled() -> Callable[[Device], Status]:
    """Wait until the device no longer streams, and return its status."""

    def status(device: Device) -> Status:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            statuses = [m for batch in device.poll(0.3) for m in batch.messages if isinstance(m, Status)]
            if statuses and statuses[-1].state in (State.HOLDING, State.IDLE):
                return statuses[-1]
        raise AssertionError("the device did not settle")

    return status


@pytest.fixture(scope="session")
def agree() -> Callable[[], bool]:
    """Confirm the release."""
    return lambda: True
