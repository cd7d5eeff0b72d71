"""Devices with a wrong or unverifiable clock, over real links: no recording is rated as good."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from dpr_lab.acquisition.arrivals import ArrivalFit, Arrivals
from dpr_lab.acquisition.capture import Captured, CaptureOptions, capture
from dpr_lab.acquisition.device import Device
from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.inspect import info
from dpr_lab.transports import open_transport
from dpr_lab.workflows.compare import CompareRequest, compare
from dpr_lab.workflows.events import RunRead
from dpr_lab.workflows.reading import read_runs
from tests.thinned import thinned

LINKS = ("pty", "slcan", "tcp:0", "virtual:wrong-clocks")
MODEL = Path(__file__).parents[1] / "tui/data/model.json"
SHORT = CaptureOptions(duration=1.5)
ATTEMPTS = 8
Record = Callable[..., Captured]


@pytest.fixture
def record(bench, paper: Rig, tmp_path: Path, agree) -> Record:
    def recorded(**options: object) -> Captured:
        with bench(**{"clock": "realtime", **options}) as (device, _):
            return capture(device, paper, "X1", SHORT, tmp_path, confirm=agree)

    return recorded


def _failed(captured: Captured) -> list[str]:
    return [check.name for check in captured.quality.checks if not check.ok]


@pytest.mark.slow
@pytest.mark.parametrize("link", thinned(LINKS, 4))
def test_a_clock_off_by_5_percent_is_seen_without_any_answer_to_ping(link: str, record: Record, paper: Rig) -> None:
    captured = record(link=link, drift_ppm=50_000.0, fault=("lose_pongs=1",))
    assert _failed(captured) == ["clock", "clock_fit"]
    assert "% fast (" in captured.quality.sentence
    assert "PING commands were answered" in captured.quality.sentence
    clock = info(captured.run_file).clock
    assert abs(clock["arrival_ppm"] - 50_000.0) < clock["arrival_margin_ppm"]
    with pytest.raises(RunError, match=r"runs .* % fast .* --any-clock"):
        read_runs([captured.run_file], paper, lambda event: None, any_clock=False)
    with pytest.raises(RunError, match=r"runs .* % fast .* --any-clock"):
        compare(CompareRequest((captured.run_file,), MODEL, None))
    assert compare(CompareRequest((captured.run_file,), MODEL, None, any_clock=True)).comparisons


@pytest.mark.slow
def test_a_frozen_pong_does_not_hide_a_clock_that_runs_twice_as_fast(record: Record) -> None:
    captured = record(drift_ppm=1e6, fault=("pong_scale=0",))
    assert _failed(captured) == ["clock", "clock_fit"]
    assert "PONG answers gave tick 0" in captured.quality.sentence


@pytest.mark.slow
def test_a_pong_of_another_timer_than_the_samples_is_seen(record: Record) -> None:
    captured = record(drift_ppm=-50_000.0, fault=(f"pong_scale={1 / 0.95:.7f}",))
    for _ in range(ATTEMPTS - 1):  # on a busy machine answers to PING are late by more than 5 % of a short recording
        if "PONG answers contradict each other" not in captured.quality.sentence:
            break
        captured = record(drift_ppm=-50_000.0, fault=(f"pong_scale={1 / 0.95:.7f}",))
    assert _failed(captured) == ["clock", "clock_fit"]
    assert "% slow (" in captured.quality.sentence
    assert "check which timer PONG reads" in captured.quality.sentence


@pytest.mark.slow
def test_a_run_without_a_clock_fit_is_degraded_and_read_with_a_warning(record: Record, paper: Rig) -> None:
    captured = record(link="slcan", fault=("lose_pongs=1",))
    assert _failed(captured) == ["clock_fit"]
    events: list[RunRead] = []
    read_runs([captured.run_file], paper, lambda event: events.append(event), any_clock=False)  # pyright: ignore
    assert any("marked this recording as degraded: the device's clock" in note for note in events[0].notes)


@pytest.mark.slow
@pytest.mark.parametrize("firmware", thinned(["c", "python"], 2))
def test_a_right_clock_is_good_with_any_firmware(firmware: str, record: Record) -> None:
    captured = record(firmware=firmware)
    assert captured.quality.ok, captured.quality.sentence
    clock = info(captured.run_file).clock
    assert abs(clock["arrival_ppm"]) < clock["arrival_margin_ppm"]


def test_a_latch_that_is_reported_closed_throughout_the_swing_degrades_the_run(record: Record) -> None:
    captured = record(clock="fast", fault=("stuck_latch=1",))
    assert _failed(captured) == ["latch"]
    assert "STATUS messages reported that the latch holds" in captured.quality.sentence


@dataclass
class Elsewhere:
    """Link to a simulated device that has the URL of a real port."""

    inner: object
    url: str

    def __getattr__(self, name: str):
        return getattr(self.inner, name)


@pytest.mark.slow
def test_a_device_on_a_real_port_cannot_call_its_time_simulated(simulated, paper: Rig, tmp_path: Path, agree) -> None:
    """Its samples arrive many times too fast, which is permitted for a simulated clock, but not for a real one."""
    link = Elsewhere(open_transport(simulated(clock="fast").url), "serial:///dev/ttyACM0")
    with Device(link) as device:  # pyright: ignore[reportArgumentType]
        assert device.connect().simulated_time
        assert not device.simulated_time
        captured = capture(device, paper, "X1", CaptureOptions(duration=30.0), tmp_path, confirm=agree)
    assert "clock" in _failed(captured)
    assert info(captured.run_file).extra["simulated_time"] == "false"


@pytest.mark.parametrize(
    ("url", "failed"), [("sim://?clock=fast", []), ("serial:///dev/pts/99", ["clock", "clock_fit"])]
)
def test_the_pace_of_a_device_of_this_program_is_no_clock_error(
    url: str, failed: list[str], simulated, paper: Rig, tmp_path: Path, agree, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy computer the samples of a simulated clock may arrive steadily at 1.26 times real time."""
    monkeypatch.setattr(Arrivals, "fit", lambda _: ArrivalFit(260_000.0, 3_000.0))
    link = Elsewhere(open_transport(simulated(clock="fast").url), url)
    with Device(link) as device:  # pyright: ignore[reportArgumentType]
        device.connect()
        captured = capture(device, paper, "X1", CaptureOptions(duration=1.0), tmp_path, confirm=agree)
    assert _failed(captured) == failed
