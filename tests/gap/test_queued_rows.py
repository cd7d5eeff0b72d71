"""Rows that wait in the queue of a saturated link."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.sensor_faults import screen
from dpr_lab.gap.screen.stamps.queued_rows import queued_rows
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from tests.saturated_link import Link, Rows, rows_at_each_change

Array = NDArray[np.float64]

COUNTS = 1000
STEP = 2 * np.pi / COUNTS
HOST_TICK_S = 0.004
SLOW = Link()


@pytest.fixture(scope="module")
def swing() -> tuple[Array, Array]:
    """Instants and angle from hanging, rad, of a rod released at 95 degrees, zero of the encoder off by 12 mrad."""
    t = np.arange(0.0, 3.0, 1e-4)
    rod = solve_ivp(
        lambda _, x: [x[1], -56.0 * np.sin(x[0]) - 0.05 * x[1]], (0.0, 3.0), [1.66, 0.0], t_eval=t, rtol=1e-8, atol=1e-9
    )
    return t, rod.y[0] - 0.012


def sent(swing: tuple[Array, Array], link: Link = SLOW) -> Rows:
    t, angle = swing
    return rows_at_each_change(t, np.rint(angle / STEP).astype(np.int64) + 522, link)


def angles(rows: Rows) -> Array:
    return STEP * rows.counts[:, None].astype(np.float64)


def on_host_ticks(arrived: Array) -> Array:
    """Stamps of a host that looks at its serial port every few milliseconds."""
    return np.ceil(arrived / HOST_TICK_S) * HOST_TICK_S + 1e-6 * np.arange(len(arrived))


@pytest.mark.parametrize("link", [SLOW, Link(19200), Link(9600, 32), Link(57600, 256)])
@pytest.mark.parametrize("stamps", [np.copy, on_host_ticks])
def test_rows_with_another_delay_than_that_of_the_full_queue_are_found(swing, link, stamps):
    rows = sent(swing, link)
    queue = queued_rows(stamps(rows.arrived), angles(rows))
    if link.baud == 57600:
        assert queue is None  # most rows arrive at once: the link is rarely full
        return
    delay = rows.arrived - rows.read
    full = np.median(delay)
    assert queue is not None
    assert queue.series >= 4
    assert np.abs(delay - full)[~queue.rows][20:].max() < 0.3e-3
    differ = np.abs(delay - full)[np.diff(rows.counts, prepend=0) ** 2 == 1]
    assert queue.differ_s == pytest.approx(np.median(differ[differ > 1e-3]), rel=0.35)


def test_stamps_at_the_reading_have_no_queue(swing):
    rows = sent(swing)
    assert queued_rows(rows.read, angles(rows)) is None


@pytest.mark.parametrize("period", [1e-3, 2.1e-3, 5.2e-3, 9.7e-3])
@pytest.mark.parametrize("step", [STEP / 8, STEP, 4 * STEP])
def test_even_rows_have_no_queue(swing, period, step):
    t, angle = swing
    rows = np.arange(0.0, 2.9, period)
    assert queued_rows(rows, step * np.rint(np.interp(rows, t, angle) / step)[:, None]) is None


@pytest.mark.parametrize("seed", range(5))
def test_even_rows_of_a_noisy_encoder_have_no_queue(swing, seed):
    t, angle = swing
    rng = np.random.default_rng(seed)
    rows = np.arange(0.0, 2.9, 2e-3)
    read = np.interp(rows, t, angle) + STEP / 4 * rng.normal(0.0, 0.5, len(rows))
    assert queued_rows(rows, STEP / 4 * np.rint(read / STEP * 4)[:, None]) is None


def test_rows_that_are_sent_at_once_have_no_queue(swing):
    rows = sent(swing, Link(460800))
    assert queued_rows(rows.arrived, angles(rows)) is None


def test_angles_without_counts_have_no_queue(swing):
    t, angle = swing
    noisy = angle[::50] + np.random.default_rng(0).normal(0.0, 1e-3, len(angle[::50]))
    assert queued_rows(t[::50], noisy[:, None]) is None
    assert queued_rows(t[:4], angle[:4, None]) is None


def rod() -> Rig:
    mass = Measure(0.1)
    return parse_rig(draft_rig(RigMeasures("queue", 0.26, 0.26, mass, mass, counts_per_rev=COUNTS))).with_rods("inner")


def recorded(rows: Rows, stamps: Array, rig: Rig) -> Run:
    theta = np.pi + STEP * (rows.counts[:, None] - 522.0) * np.ones(3)
    counts = rows.counts[:, None] * np.ones(3, dtype=np.int64)
    rate = 1.0 / float(np.median(np.diff(stamps)))
    return Run("queue", stamps - stamps[0], theta, counts, None, rig.rig.name, "", rate, mounting="inner")


def test_the_fault_is_named_with_its_size_and_its_rows_are_excluded(swing):
    rows, rig = sent(swing), rod()
    screened = screen(recorded(rows, on_host_ticks(rows.arrived), rig), rig)
    fault = next(finding for finding in screened.findings if finding.name == "queued_rows")
    assert "baud rate" in fault.evidence
    assert "ms" in fault.evidence
    late = np.abs((rows.arrived - rows.read) - np.median(rows.arrived - rows.read)) > 1e-3
    assert not screened.keep[late[-len(screened.keep) :], 0][20:].any()


@pytest.mark.slow
def test_no_friction_or_spring_is_named_in_place_of_a_queue(swing):
    rows, rig = sent(swing), rod()
    diagnosis = diagnose([recorded(rows, on_host_ticks(rows.arrived), rig)], rig)
    assert "queued_rows" in {finding.name for finding in diagnosis.sensor_findings}
    assert diagnosis.effects[0].name == "encoder_offset_joint1"
    assert all(effect.probability < 0.5 for effect in diagnosis.effects[1:])
