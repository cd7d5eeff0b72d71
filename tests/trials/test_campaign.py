"""Campaigns: continued after an interruption, identical on one machine and on a cluster, with one page at the end."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from html.parser import HTMLParser
from pathlib import Path

import pytest

from dpr_lab.errors import DprError, LinkError, RunError
from dpr_lab.report.plain import as_json
from dpr_lab.report.trials.figures import save_trial_figures
from dpr_lab.report.trials.html import sentence, write_trials_report
from dpr_lab.trials.campaign import Campaign, read_trials, run_campaign
from dpr_lab.trials.score import Cause, Claim, SizeError, TrialOutcome
from dpr_lab.trials.sealing import Kind
from dpr_lab.trials.summary import summary, with_nulls
from dpr_lab.trials.workers import on_cluster, on_this_machine

CLEAN = Campaign((Kind.CLEAN,), seed=11)


def outcome(**changes: object) -> TrialOutcome:
    usual = {
        "kind": "single",
        "level": "clear",
        "seed": 1,
        "truth": ("coulomb_joint1",),
        "held_back": False,
        "verdict": "named",
        "named": ("coulomb_joint1",),
        "class_sizes": (1,),
        "first": True,
        "top3": True,
        "exact": True,
        "invented": False,
        "silent": False,
        "wrong_name": False,
        "admitted": False,
        "explained_share": 0.99,
        "closed": float("nan"),
        "sizes": (SizeError("coulomb_joint1", "torque_Nm", 0.01, True, True),),
        "claims": (Claim(0.98, True),),
        "sensor_findings": (),
        "faults_missed": (),
        "seconds": 3.0,
        "causes": (Cause("coulomb_joint1", 7.0, True),),
    }
    return TrialOutcome(**{**usual, **changes})  # pyright: ignore[reportArgumentType]


def lines(folder: Path, *numbers: int) -> bytes:
    return b"".join(json.dumps({"number": i, "outcome": outcome(seed=i).to_json()}).encode() + b"\n" for i in numbers)


def test_a_line_that_a_kill_cut_short_is_dropped(tmp_path: Path) -> None:
    whole = lines(tmp_path, 0, 4)
    file = tmp_path / "trials.jsonl"
    for cut in (1, 40, len(whole) // 2 - 1):
        file.write_bytes(whole + whole[:cut])
        assert list(read_trials(tmp_path)) == [0, 4]
        assert file.read_bytes() == whole
    assert read_trials(tmp_path)[4].seed == 4


def test_a_complete_line_that_is_not_a_trial_is_reported(tmp_path: Path) -> None:
    (tmp_path / "trials.jsonl").write_bytes(lines(tmp_path, 0) + b'{"number": 1}\n')
    with pytest.raises(RunError, match="line 2 is not a trial"):
        read_trials(tmp_path)


def test_a_campaign_that_is_done_runs_nothing(tmp_path: Path) -> None:
    result: list[int] = []
    (tmp_path / "trials.jsonl").write_bytes(lines(tmp_path, 2, 0, 1, 7))
    tried = run_campaign(CLEAN, 3, tmp_path, on_trial=lambda done, last: result.append(done))
    assert [o.seed for o in tried.outcomes] == [0, 1, 2]
    assert result == [3]


def test_a_folder_holds_one_campaign(tmp_path: Path) -> None:
    (tmp_path / "trials.jsonl").write_bytes(lines(tmp_path, 0))
    run_campaign(CLEAN, 1, tmp_path)
    with pytest.raises(RunError, match=r"another campaign \(seed = 11\)"):
        run_campaign(Campaign((Kind.CLEAN,), seed=12), 1, tmp_path)


def test_a_folder_holds_one_running_campaign(tmp_path: Path) -> None:
    refused: list[str] = []

    def once_more(done: int, last: object) -> None:
        with pytest.raises(RunError) as error:
            run_campaign(CLEAN, 1, tmp_path)
        refused.append(str(error.value))

    (tmp_path / "trials.jsonl").write_bytes(lines(tmp_path, 0))
    run_campaign(CLEAN, 1, tmp_path, on_trial=once_more)
    assert len(refused) == 1
    assert "a campaign is running in this folder; wait" in refused[0]
    assert len(run_campaign(CLEAN, 1, tmp_path).outcomes) == 1


def test_kinds_come_in_turn_and_seeds_one_after_the_other() -> None:
    cases = Campaign((Kind.CLEAN, Kind.PAIR), seed=5).cases(range(1, 4))
    assert [(case["number"], case["kind"], case["seed"]) for case in cases] == [
        (1, "pair", 6),
        (2, "clean", 7),
        (3, "pair", 8),
    ]
    assert json.loads(json.dumps(cases)) == cases


@pytest.mark.slow
def test_processes_give_results_and_errors() -> None:
    cases = [{"number": number} for number in range(4)]
    assert sorted(case["number"] for case, result in on_this_machine(dict, cases, 2) if result == case) == [0, 1, 2, 3]
    # A job that cannot take its case stands for any trial that fails.
    failed = list(on_this_machine(int, cases[:2], 1))  # pyright: ignore[reportArgumentType]
    assert all(result["error"].startswith("TypeError") for _, result in failed)


@pytest.mark.slow
def test_a_process_that_dies_ends_the_campaign_with_a_sentence() -> None:
    with pytest.raises(DprError, match="run the command again to continue"):
        list(on_this_machine(_die, [{}], 1))


def _die(case: dict[str, object]) -> dict[str, object]:
    os._exit(9)


@pytest.mark.slow
def test_without_a_scheduler_the_operator_reads_what_to_start() -> None:
    pytest.importorskip("distributed", reason="dask.distributed is not installed")
    with pytest.raises(LinkError, match="is not an address of a scheduler"):
        list(on_cluster(dict, [{}], "somewhere"))
    with pytest.raises(LinkError, match="no scheduler answers"):
        list(on_cluster(dict, [{}], "tcp://127.0.0.1:1", connect_s=1))


@pytest.mark.slow
@pytest.mark.parametrize(
    "answer", [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\xff" * 64, b""], ids=["web", "noise", "mute"]
)
def test_a_peer_that_is_not_a_scheduler_is_reported_in_a_sentence(answer: bytes) -> None:
    pytest.importorskip("distributed", reason="dask.distributed is not installed")
    with socket.create_server(("127.0.0.1", 0)) as server:
        peer = threading.Thread(target=_answer_all, args=(server, answer), daemon=True)
        peer.start()
        with pytest.raises(LinkError, match="no scheduler answers: check host and port"):
            list(on_cluster(dict, [{}], f"tcp://127.0.0.1:{server.getsockname()[1]}", connect_s=2))
        server.shutdown(socket.SHUT_RDWR)
        peer.join()


def _answer_all(server: socket.socket, answer: bytes) -> None:
    with suppress(OSError):  # the test is over
        while True:
            peer, _ = server.accept()
            with peer, suppress(OSError):
                peer.recv(100)
                peer.sendall(answer)


VOID = {"meta", "link", "img", "br", "hr"}


class Page(HTMLParser):
    """Parser that checks that every element is closed in order and no other file is loaded."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.feed(source)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        assert all(str(value).startswith("data:") for name, value in attrs if name in ("src", "href"))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.slow
@pytest.mark.parametrize(
    "outcomes",
    [
        [],
        [outcome()],
        [outcome(kind="clean", truth=(), named=(), verdict="no_gap", silent=True, causes=(), sizes=(), claims=())],
        [
            outcome(),
            outcome(seed=2, named=("<base_tilt>",), first=False, exact=False, invented=True, wrong_name=True),
            outcome(kind="outside", truth=("air_draught",), named=(), verdict="unexplained", admitted=True, causes=()),
        ],
    ],
    ids=["none", "one", "clean", "several"],
)
def test_the_page_is_whole_and_fetches_nothing(outcomes, tmp_path: Path) -> None:
    counted = summary(outcomes)
    figures = save_trial_figures(counted, tmp_path)
    page = write_trials_report(counted, "Hidden: <things>.", ["trial 3: it broke & burned"], tmp_path, figures)
    source = page.read_text(encoding="utf-8")
    Page(source)
    assert "&lt;things&gt;" in source
    assert "it broke &amp; burned" in source
    assert f"{len(outcomes)} trials" in sentence(counted)
    assert "nan" not in source.split("<body>")[1].split("base64")[0]
    if len(outcomes) == 3:
        assert "&lt;base_tilt&gt;" in source


def campaign_words(out: Path, n: int, *more: object) -> list[str]:
    words = ["trials", "campaign", "--n", n, "--kind", "clean", "--seed", 11, "--out", out, "--json", *more]
    return [sys.executable, "-m", "dpr_lab", *map(str, words)]


def told_by(out: Path, n: int, *more: object) -> dict:
    done = subprocess.run(campaign_words(out, n, *more), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def wait_until(holds, seconds: float = 120) -> None:
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def members(group: int) -> list[int]:
    """Processes of a process group."""
    result: list[int] = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, pgrp = stat.read_text().rpartition(")")[2].split()[:3]
        except OSError:
            continue
        if int(pgrp) == group and state != "Z":
            result.append(int(stat.parent.name))
    return result


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc to see what a kill leaves running")
def test_a_killed_campaign_leaves_no_process_and_can_be_continued(tmp_path: Path) -> None:
    file, temporary = tmp_path / "trials.jsonl", tmp_path / "temporary"
    temporary.mkdir()
    process = subprocess.Popen(
        campaign_words(tmp_path, 4, "--jobs", 2),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )
    wait_until(lambda: file.exists() and file.read_bytes().count(b"\n") >= 1)
    process.send_signal(signal.SIGKILL)
    process.wait(60)
    wait_until(lambda: not members(process.pid), 60)
    assert not list(temporary.iterdir())
    with file.open("ab") as cut:
        cut.write(b'{"number": 3, "outc')
    before = file.read_bytes().splitlines()[:-1]
    assert 1 <= len(before) < 4
    result = told_by(tmp_path, 4, "--jobs", 1)
    after = file.read_bytes().splitlines()
    assert after[: len(before)] == before
    assert sorted(json.loads(line)["number"] for line in after) == [0, 1, 2, 3]
    assert result["trials"] == 4
    assert result["false_alarms"] == 0.0
    assert Path(result["files"]["page"]).is_file()


@contextmanager
def dask(*words: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "distributed.cli." + words[0], *words[1:], "--no-dashboard"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(60)
            except subprocess.TimeoutExpired:
                process.kill()


@pytest.mark.long
@pytest.mark.timeout(900)
def test_two_workers_of_a_scheduler_do_what_one_machine_does(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="dask.distributed is not installed")
    where = tmp_path / "scheduler.json"
    with dask("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(where)):
        wait_until(where.exists, 60)
        address = json.loads(where.read_text())["address"]
        assert address.startswith("tcp://127.0.0.1:")
        worker = ("dask_worker", address, "--host", "127.0.0.1", "--nthreads", "1", "--no-nanny")
        with dask(*worker, "--local-directory", str(tmp_path)), dask(*worker, "--local-directory", str(tmp_path)):
            told_by(tmp_path / "cluster", 2, "--scheduler", address)
    told_by(tmp_path / "here", 2, "--jobs", 1)
    assert comparable(tmp_path / "cluster") == comparable(tmp_path / "here")


LOCAL = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as cluster:
        sys.argv[1:] = [*sys.argv[1:], "--scheduler", cluster.scheduler_address]
        from dpr_lab.cli import main
        main()
"""


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_local_cluster_does_it_too(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="dask.distributed is not installed")
    script = tmp_path / "local.py"
    script.write_text(LOCAL)
    words = campaign_words(tmp_path / "out", 2)[3:]
    done = subprocess.run([sys.executable, str(script), *words], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["trials"] == 2


def comparable(folder: Path) -> list[dict]:
    """Trials in order, without fields that differ between runs."""
    kept = (json.loads(line) for line in (folder / "trials.jsonl").read_text().splitlines())
    ordered = sorted(kept, key=lambda line: line["number"])
    return [line["outcome"] | {"seconds": None, "seal": None} for line in ordered]


def test_scores_without_trials_are_null_in_json_without_a_warning() -> None:
    scores = json.loads(as_json(with_nulls(summary([outcome(sizes=(), claims=())]))))
    assert scores["by_effect"][0]["size_error_p90"] is None
    assert scores["brier"] is None
    assert scores["seconds"] == 3.0
