"""The program `python -m sim_device`."""

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from dpr_lab.rig import PARAMETERS
from firmware_protocol.messages import Hold, Stream
from tests.thinned import thinned
from tests.warm_process import started

TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@contextmanager
def running(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    words, pipe = ["--exit-with-parent", *arguments], subprocess.PIPE
    with started("sim_device", words, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def url_of(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return json.loads(process.stdout.readline())["url"]


def cpu_s(process: subprocess.Popen[str]) -> float:
    with open(f"/proc/{process.pid}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def test_help_explains_itself(program):
    done = program("--help")
    assert done.code == 0
    assert "python -m sim_device --rig paper --plant paper --link pty" in done.out
    assert "cut_after_s" in done.out


@pytest.mark.slow
def test_it_answers_before_what_moves_the_rods_is_compiled(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))  # as on a computer that never ran it
    with running() as process:
        url_of(process)
        assert cpu_s(process) < 6.0


def test_reveal_prints_the_truth_of_the_same_arguments(program):
    first, again, other = (program("--reveal", "--draw", "--seed", seed).out for seed in ("5", "5", "6"))
    assert first == again != other
    document = json.loads(first)
    assert tuple(document["parameters"]) == PARAMETERS
    assert set(document["ratios"]) == {"a/b", "d/b", "e1/b", "c1/b", "c2/b"}
    assert json.loads(program("--reveal", "--plant", "dry").out)["effects"]["coulomb_joint1"]["torque_Nm"] > 0


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("--link", "tcp:0.0.0.0:5000"), 4, "on this machine only"),
        (("--plant", "none"), 3, "nor the name of a built-in plant"),
        (("--rig", "none"), 3, "nor the name of a built-in rig"),
        (("--fault", "drop=2"), 3, "write drop=VALUE"),
        (("--seed", "-1"), 2, "not a whole number"),
        (("--uid", "xyz"), 2, "not a hexadecimal number"),
    ],
)
def test_errors_are_reported_on_stderr(program, arguments, code, message):
    done = program(*arguments)
    assert done.code == code
    assert message in done.err
    assert "Traceback" not in done.err
    assert done.out == ""


@pytest.mark.slow
def test_it_ends_with_its_parent():
    with running() as process:
        assert url_of(process).startswith("serial:///dev/")
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(60) == 0


@pytest.mark.slow
@pytest.mark.parametrize("number", thinned([signal.SIGTERM, signal.SIGINT], 2))
def test_it_ends_on_a_signal(number):
    with running("--link", "tcp:0") as process:
        assert url_of(process).startswith("socket://127.0.0.1:")
        process.send_signal(number)
        assert process.wait(60) == 0


@pytest.mark.slow
def test_uid_and_rates_are_reported(bench):
    with running("--uid", "1a2b3c4d5e6f7788", "--clock", "fast") as process:
        host = bench.connect(url_of(process))
        host.hello()
        assert host.session.info.uid == "1a2b3c4d5e6f7788"
        assert host.session.info.counts_per_rev == (16384, 16384, 16384)
        assert host.session.info.rate_max_hz == 4000


@pytest.mark.long
def test_real_time_keeps_pace_at_1_khz_within_a_quarter_of_a_core(bench):
    with running("--clock", "realtime") as process:
        host = bench.connect(url_of(process))
        host.hello()
        host.do(Hold(pose=1))
        host.run_for(0.6)
        host.do(Stream(rate_hz=1000))
        host.run_for(0.5)
        before, used = len(host.counts()), cpu_s(process)
        began = host.now()
        host.run_for(2.0)
        passed = host.now() - began
        ticks = host.counts()[:, 0]
        assert (np.diff(ticks) == 1).all()
        assert len(ticks) - before == pytest.approx(1000 * passed, abs=250)  # a loaded host reads late
        assert (cpu_s(process) - used) / passed < 0.25
