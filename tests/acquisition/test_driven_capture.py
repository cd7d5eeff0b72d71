"""Capture of a driven swing: each sample has its torques or is counted as lost, and absolute values are identified."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.acquisition.capture import CaptureOptions, capture
from dpr_lab.acquisition.conformance import conformity
from dpr_lab.acquisition.device import Device
from dpr_lab.dynamics.base import BASE, base_parameters
from dpr_lab.errors import LinkError
from dpr_lab.identification.identify import identify
from dpr_lab.rig import Rig
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Received
from firmware_protocol.identity import PAGES
from firmware_protocol.messages import NUMBERS, Info
from sim_device.plant.config import load_plant
from tests.thinned import thinned

SHORT = CaptureOptions(duration=1.0, pose_timeout=60.0, rest_timeout=60.0)
T = np.arange(0, 3.0, 0.05)
TAU = np.column_stack([0.15 * np.sin(5.6 * T) + 0.1 * np.sign(np.sin(2.3 * T)), 0.06 * np.sin(10.7 * T + 1)]).round(4)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    file = tmp_path / "torques.csv"
    np.savetxt(file, np.column_stack([T, TAU]), fmt="%.4f", delimiter=",", header="t_s,tau1_Nm,tau2_Nm", comments="")
    return file


@pytest.mark.slow
def test_lost_torques_are_counted_reported_and_not_interpolated(
    paper: Rig, tmp_path: Path, table: Path, bench, agree
) -> None:
    with bench(torques=table, fault=("lose_torques=0.02",)) as (device, spy):
        captured = capture(device, paper, "X2", SHORT, tmp_path, confirm=agree)
        assert max(spy.sent) <= 39  # nothing that dpr.dbc does not name goes out
    run = load_run(captured.run_file, paper)
    lost = run.lost["torque"]
    assert lost > 20
    assert sum(run.lost.values()) == lost
    assert f"{lost} samples arrived without their torques" in captured.quality.sentence
    assert "degraded: lost samples: torque" in captured.quality.sentence
    rows = np.searchsorted(T, run.swing.t + 1e-9, side="right") - 1
    assert run.swing.torques == pytest.approx(TAU[rows], abs=1e-9)
    assert run.swing.commanded == pytest.approx(TAU[rows], abs=1e-9)
    assert run.torque_kind == "measured"
    assert not run.driven_by("commanded").between(-1.0, 0.0).torques.any()  # pyright: ignore


class WithoutPage:
    """Link that loses one page of INFO."""

    def __init__(self, inner) -> None:
        self.inner = inner

    def __getattr__(self, name: str):
        return getattr(self.inner, name)

    def receive(self, timeout: float) -> Received:
        came = self.inner.receive(timeout)
        return replace(
            came, frames=tuple(f for f in came.frames if (f.number, f.data[:1]) != (NUMBERS[Info], bytes([PAGES])))
        )


@pytest.mark.slow
def test_torques_of_no_known_unit_are_refused(paper: Rig, tmp_path: Path, table: Path, simulated, agree) -> None:
    link = WithoutPage(open_transport(simulated(torques=table).url))
    with Device(link) as device:  # pyright: ignore[reportArgumentType]
        device.connect()
        with pytest.raises(LinkError, match="the INFO page that contains their unit was lost: connect again"):
            capture(device, paper, "X2", SHORT, tmp_path, confirm=agree)


@pytest.mark.slow
def test_a_driven_rig_is_identified_in_absolute_numbers_over_either_link(
    paper: Rig, tmp_path: Path, table: Path, bench, agree
) -> None:
    runs = []
    for link, pose in (("pty", "X2"), ("virtual:driven-2", "X2"), ("virtual:driven-1", "X1")):
        with bench(link=link, torques=table) as (device, _):
            captured = capture(device, paper, pose, replace(SHORT, duration=3.0), tmp_path / link[:3], confirm=agree)
        assert captured.quality.ok, captured.quality.sentence
        runs.append(load_run(captured.run_file, paper))
    serial, bus, other = runs
    assert np.array_equal(serial.swing.theta, bus.swing.theta)
    assert np.array_equal(serial.swing.torques, bus.swing.torques)
    model = identify([bus, other], paper)
    truth = dict[str, float](zip(BASE, base_parameters(load_plant("paper").Z, paper.L1, paper.g), strict=True))
    for name, value in model.base.items():
        assert value.fixed_by == "data"
        assert value.value == pytest.approx(truth[name], abs=3 * (value.std or 0.0)), name


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("firmware", thinned(["c", "python"], 2))
def test_a_device_with_drives_conforms(simulated, table: Path, firmware: str) -> None:
    """In `tests/firmware_c/test_c_traces.py`, both implementations run every exchange without waiting."""
    from dpr_lab.acquisition.conformance import ConformanceSettings

    link = open_transport(simulated(clock="realtime", firmware=firmware, torques=table).url)
    try:
        patient = ConformanceSettings(patience_s=60.0, rate_off=0.5, reports_hz=(1.0, 30.0))
        result = list(conformity(link, patient))
    finally:
        link.close()
    assert [(one.what, one.message) for one in result if not one.ok] == []
    assert {"every sample has its torques"} < {one.what for one in result}
    assert any("with joint drives reports them first" in one.what for one in result)
