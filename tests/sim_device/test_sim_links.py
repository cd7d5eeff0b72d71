"""Simulated device at the other end of every link."""

import os
import time

import numpy as np
import pytest

from dpr_lab.errors import LinkError
from firmware_protocol.errors import CommandRefused
from firmware_protocol.framing import encode_frame
from firmware_protocol.messages import Hold, NakCode, Position, Sample, Status, Stop, Stream, encode
from sim_device.faults import Faults
from sim_device.links.link import LIMITS
from sim_device.links.open_link import open_link

SWING = 1500


def swing_counts(host, **options) -> np.ndarray:
    tick = host.release(swing=SWING, **options)
    counts = host.counts()
    assert (np.diff(counts[:, 0]) == 1).all()
    return counts[tick : tick + SWING, 1:]


@pytest.mark.parametrize("link", ["pty", "slcan", "tcp:0", "virtual:counts"])
def test_the_same_seed_gives_the_same_counts_over_any_link(bench, link):
    reference = swing_counts(bench.direct(seed=7), pose=2)
    assert np.array_equal(swing_counts(bench.host(link=link, clock="fast", seed=7), pose=2, rest=150), reference)


def test_another_seed_gives_other_counts(bench):
    assert not np.array_equal(swing_counts(bench.direct(seed=7)), swing_counts(bench.direct(seed=8)))


@pytest.mark.slow
def test_counts_do_not_depend_on_the_clock(bench):
    realtime = swing_counts(bench.host(link="pty", clock="realtime"), pose=3, rest=50)
    assert np.array_equal(realtime, swing_counts(bench.host(link="pty", clock="fast"), pose=3))


def test_the_fast_clock_says_so(bench):
    assert bench.host(link="pty", clock="fast").session.info.simulated_time
    assert not bench.host(link="pty", clock="realtime").session.info.simulated_time


def test_a_host_at_the_wrong_baud_rate_sees_bytes_and_no_frame(bench):
    url = bench.serve(link="pty", baud=921_600)
    host = bench.connect(url.replace("921600", "115200"))
    host.end.write(host.session.hello(host.now()))
    host.until(lambda: host.end.bytes_in > 0 and host.session.outcome is not None)
    assert host.messages == []


def test_a_rate_of_no_standard_is_a_rate_too(bench):
    bench.host(link="pty", baud=1_234_567)


def test_a_port_can_be_closed_and_opened_again(bench):
    url = bench.serve(link="pty", clock="fast")
    first = bench.connect(url)
    first.hello()
    first.do(Hold(pose=1))
    first.do(Stream(rate_hz=1000))
    first.end.close()
    time.sleep(0.1)
    second = bench.connect(url)
    second.hello()
    second.do(Stop())
    assert second.release() > 0


def test_the_next_host_on_tcp_is_served_too(bench):
    url = bench.serve(link="tcp:0", clock="fast")
    first = bench.connect(url)
    first.hello()
    first.end.close()
    bench.connect(url).hello()


@pytest.mark.parametrize("address", ["0.0.0.0:5555", "192.168.1.5:5555", ":::5555", "example.org:80"])
def test_tcp_listens_on_this_machine_only(address):
    with pytest.raises(LinkError, match="on this machine only"):
        open_link(f"tcp:{address}")


@pytest.mark.parametrize("name", ["tcp:", "tcp:x", "tcp:70000"])
def test_a_wrong_port_number_is_named(name):
    with pytest.raises(LinkError, match="is not a port number"):
        open_link(name)


def test_a_taken_tcp_port_is_named():
    link = open_link("tcp:0")
    port = link.address.url.rpartition(":")[2]
    with pytest.raises(LinkError, match=f"cannot listen on 127.0.0.1:{port}"):
        open_link(f"tcp:{port}")
    link.close()


def test_an_unknown_link_is_named_with_those_there_are():
    with pytest.raises(LinkError, match=r"unknown kind of link 'usb' \(available: pty, slcan"):
        open_link("usb:1")


@pytest.mark.parametrize(("link", "baud", "rate_max_hz"), [("pty", 115_200, 658), ("slcan", 125_000, 740)])
def test_a_rate_the_link_cannot_carry_is_refused(bench, link, baud, rate_max_hz):
    host = bench.host(link=link, baud=baud)
    assert host.session.info.rate_max_hz == rate_max_hz
    host.do(Hold())
    with pytest.raises(CommandRefused) as caught:
        host.do(Stream(rate_hz=rate_max_hz + 1))
    assert caught.value.code is NakCode.RATE_TOO_HIGH
    host.do(Stream(rate_hz=rate_max_hz))


def test_a_slow_host_loses_frames_in_real_time_and_none_when_the_device_waits():
    frames = [encode(Position(0, 0, tick)) for tick in range(20_000)]
    bounded, lossless = open_link("pty"), open_link("pty", lossless=True)
    for link in (bounded, lossless):
        host = os.open(link.address.url.removeprefix("serial://").partition("?")[0], os.O_RDWR | os.O_NOCTTY)
        dropped = link.send(frames)
        assert link.blocked
        assert bool(dropped) is (link is bounded)
        if dropped:
            kept = frames[: len(frames) - len(dropped)]
            assert len(b"".join(map(encode_frame, kept))) <= LIMITS.queue_bytes
        os.close(host)
        link.close()


@pytest.mark.slow
def test_dropped_samples_are_reported(bench):
    host = bench.host(link="pty", clock="realtime")
    host.do(Hold())
    host.do(Stream(rate_hz=4000))
    began = time.monotonic()
    while time.monotonic() - began < 1.9:  # alive, but not reading
        for frame in host.session.due(host.now()):
            host.end.write(frame)
        time.sleep(0.02)
    host.run_for(0.5)
    host.do(Stop())
    heard = len(host.of(Status))
    host.until(lambda: len(host.of(Status)) > heard)  # nothing is dropped any more
    result, ticks = host.of(Status)[-1], host.counts()[:, 0]
    assert result.dropped > 0
    assert len(ticks) == result.sent
    assert 0 < np.sum(np.diff(ticks) - 1) <= result.dropped  # a busy host may miss the last ones too
    assert host.of(Status)[-1].overruns == 0


def test_cut_after_takes_the_link_away(bench):
    host = bench.host(link="pty", clock="fast", fault=("cut_after_s=10",))
    host.do(Hold())
    host.do(Stream(rate_hz=1000))
    with pytest.raises(OSError, match=r"failed|no data|Input/output error"):
        host.run_for(60.0)
    bench.thread.join(60.0)
    assert not bench.thread.is_alive()
    assert 100 <= len(host.of(Sample)) <= 11_100  # what was on its way is lost, up to some thousands


def test_reset_after_restarts_the_device_once(bench):
    host = bench.host(link="pty", clock="fast", fault=("reset_after_s=0.5",))
    host.do(Hold())
    host.do(Stream(rate_hz=1000))
    host.run_for(0.3)
    with pytest.raises(CommandRefused) as caught:
        host.do(Stop())
    assert caught.value.code is NakCode.NOT_GREETED
    host.hello()
    assert host.release(rest=1000) > 0


def test_can_at_another_bit_rate_hears_nothing(bench):
    url = bench.serve(link="slcan", baud=500_000)
    host = bench.connect(url.replace("500000", "1000000"))
    host.end.write(host.session.hello(host.now()))
    host.run_for(0.4)
    assert host.messages == []


def test_byte_faults_are_refused_on_can():
    with pytest.raises(LinkError, match="use pty or tcp"):
        open_link("slcan", faults=Faults({"flip": 0.1}))
    with pytest.raises(LinkError, match="CAN does not run at 921600 bit/s"):
        open_link("slcan", baud=921_600)


def test_an_idle_pty_without_a_host_costs_nothing(bench):
    bench.serve(link="pty")
    time.sleep(0.05)
    began = time.process_time()
    time.sleep(0.5)
    assert time.process_time() - began < 0.1
