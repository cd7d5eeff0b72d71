"""Clock of the device: drift and offset with their uncertainty in every run, and no change of the recorded times."""

import time
from datetime import datetime, timedelta, tzinfo
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.acquisition import capture
from dpr_lab.report.run_names import run_name
from dpr_lab.storage import metadata
from dpr_lab.storage.inspect import info
from dpr_lab.storage.reader import load_run

DRIFTS_PPM = (-500.0, -200.0, -50.0, 0.0, 50.0, 200.0, 500.0)
LINKS = {"serial": "pty", "CAN": "slcan"}
FIRST = ((-50.0, "serial"),)
"""Cases of the fast tests."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("drift_ppm", "link"),
    [
        pytest.param(drift, link, marks=[] if (drift, link) in FIRST else [pytest.mark.long])
        for drift in DRIFTS_PPM
        for link in LINKS
    ],
)
def test_injected_drift_is_recovered_within_the_stated_interval(drift_ppm: float, link: str, serve, operate) -> None:
    before = time.time()
    done = operate(serve(link=LINKS[link], clock="realtime", drift_ppm=drift_ppm), "--duration", "5")
    after = time.time()
    assert done.code == 0, done.message
    clock = info(done.runs[0]).clock
    assert abs(clock["rate_ppm"] - drift_ppm) < 4 * clock["rate_ppm_std"]
    assert clock["rate_ppm_std"] > 0
    assert clock["offset_std"] > 0
    assert before < clock["offset_unix"] < after


class Early(datetime):
    """Computer whose clock was never set, with runs before 1970."""

    BACK_S = 60 * 365.25 * 86400

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:
        return datetime.now(tz) - timedelta(seconds=cls.BACK_S)


def test_a_clock_before_1970_records_and_reads_as_any_other(
    serve, operate, command, monkeypatch, tmp_path: Path
) -> None:
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() - Early.BACK_S)
    for module in (capture, metadata):
        monkeypatch.setattr(module, "datetime", Early)
    done = operate(serve(), "--duration", "0.5")
    assert (done.code, len(done.runs)) == (0, 1), done.message
    (file,) = done.runs
    assert file.name.startswith("196")
    assert info(file).created_utc.startswith("196")
    assert " (196" in run_name(file)
    for words in (("info", file), ("verify", file), ("export", file, "--out", tmp_path / "swing.csv")):
        code, result = command("run", *words)
        assert (code, "Traceback" in result) == (0, False), result
    assert (tmp_path / "swing.csv").is_file()


def test_simulated_time_has_no_clock_drift(serve, operate) -> None:
    done = operate(serve(), "--duration", "0.5")
    assert info(done.runs[0]).clock == {}


@pytest.mark.long
@pytest.mark.parametrize("link", [pytest.param("serial", marks=pytest.mark.long), "CAN"])
def test_lost_host_times_do_not_change_device_time(link: str, serve, operate, wrong_samples) -> None:
    stalled = serve(link=LINKS[link], clock="realtime", drift_ppm=200.0, fault=("stall_ms=350", "drop=0.02"))
    done = operate(stalled, "--duration", "3")
    run = load_run(done.runs[0])
    ticks = np.round(run.t * 1000)
    np.testing.assert_array_equal(run.t, ticks / 1000)
    assert np.all(np.diff(ticks) >= 1)
    assert wrong_samples(done.runs[0], drift_ppm=200.0) == 0
    clock = info(done.runs[0]).clock
    assert abs(clock["rate_ppm"] - 200.0) < 6 * clock["rate_ppm_std"]  # stalls of the host are not normal


@pytest.mark.parametrize(
    ("link", "baud", "message"),
    [
        ("pty", 115_200, "1000 Hz needs 140,000 bit/s, 122 % of 115200 baud (at most 80 % may be used)"),
        ("slcan", 125_000, "1000 Hz needs 135,000 bit/s, 108 % of a 125000 bit/s bus (at most 80 % may be used)"),
    ],
)
def test_a_rate_the_link_cannot_carry_is_refused_with_the_arithmetic(
    link: str, baud: int, message: str, serve, operate, matrix, tmp_path: Path
) -> None:
    done = operate(serve(link=link, baud=baud))
    assert (done.code, done.runs) == (4, [])
    assert message in done.message
    assert "choose at most" in done.message
    shown = {"pty": "serial", "slcan": "CAN"}[link]
    matrix.show("a rate that the link cannot carry", shown, done.message, done.code, "no RELEASE sent, no file created")
