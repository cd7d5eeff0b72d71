"""Fixtures for fault tests: simulated devices, the command line, and the true counts."""

import os
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dpr_lab.cli import main
from dpr_lab.rig import load_rig
from dpr_lab.run import Run
from dpr_lab.storage.reader import load_run
from sim_device.assemble import hidden_plant
from sim_device.options import Options
from sim_device.plant.operator import HABITS
from sim_device.plant.rods import SimulatedRods

DOC = Path(__file__).parents[2] / "docs" / "reliability.md"
HEAD = "| message to the operator | faults (links) | exit code | surviving data |"
WRITE = "DPR_LAB_WRITE_DOCS"
SEED = 5


@dataclass(frozen=True)
class Done:
    """Result of a command."""

    code: int
    message: str
    """Last line on stderr."""
    runs: list[Path]


@pytest.fixture
def serve(simulated) -> Callable[..., str]:
    """Run a simulated device and return the URL of its link."""
    return lambda **options: simulated(**{"seed": SEED, **options}).url


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Run `dpr-lab` in this process, and return its exit code and its last message."""

    def run(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["dpr-lab", *map(str, words)])
        code: Any = 0
        try:
            main()
        except SystemExit as exit_:
            code = exit_.code or 0
        lines = capsys.readouterr().err.strip().splitlines()
        return code, lines[-1] if lines else ""

    return run


@pytest.fixture
def operate(tmp_path: Path, command: Callable[..., tuple[int, str]]) -> Callable[..., Done]:
    """Run `dpr-lab capture` over a link."""

    def run(link: str, *words: str, out: Path = tmp_path / "runs") -> Done:
        asked = ("capture", "--rig", "paper", "--pose", "X1", "--yes", "--link", link, "--out", out)
        code, result = command(*asked, *words)
        return Done(code, result, sorted(out.glob("*.mcap")) if out.is_dir() else [])

    return run


Truth = Callable[..., NDArray[np.int64]]


@pytest.fixture(scope="session")
def truth() -> Truth:
    """True counts of the plant by tick, computed without device, link and host."""

    def counts(run: Run, release_tick: int, release: int = 1, **options: Any) -> NDArray[np.int64]:
        chosen = Options(**{"seed": SEED, **options})
        rig = load_rig(chosen.rig)
        rods = SimulatedRods(hidden_plant(chosen), rig, clock_rate=1 + chosen.drift_ppm * 1e-6)
        for _ in range(release - 1):
            rods.place(1, 0.0)
            rods.let_go(1.0, run.rate_hz)
        rods.place(1, 2.0)
        ticks = release_tick + np.round(run.t * run.rate_hz).astype(np.int64)
        held = rods.held_counts(10 * HABITS.placing_time + np.arange(release_tick) / run.rate_hz, 0)
        rods.let_go(20 * HABITS.placing_time, round(run.rate_hz))
        swung = rods.swing_counts(0, max(1, int(ticks[-1]) - release_tick + 1))
        return np.concatenate([held, swung])[ticks]

    return counts


@pytest.fixture(scope="session")
def wrong_samples(truth: Truth) -> Callable[..., int]:
    """Number of samples of a run file that differ from the true counts at their tick."""

    def count(path: Path, **options: Any) -> int:
        from dpr_lab.storage.inspect import info

        run = load_run(path, verify=False)
        assert run.counts is not None
        release_tick = info(path).release_tick
        assert release_tick is not None
        return int(np.any(run.counts != truth(run, release_tick, **options), axis=1).sum())

    return count


class Matrix:
    """Table of messages in the documentation. Each test compares the row of its message, or writes it."""

    def __init__(self) -> None:
        self.write = os.environ.get(WRITE) == "1"
        self.results = _documented(_table(DOC.read_text(encoding="utf-8")))
        """Message, exit code and surviving data for each fault and link."""

    def show(self, fault: str, link: str, message: str, code: int, survives: str) -> None:
        result = (_plain(message), str(code), survives)
        if self.write:
            self.results[fault, link] = result
        documented = self.results.get((fault, link))
        assert documented == result, f"not in {DOC.name}: run the tests once with {WRITE}=1 and read what changed"

    def close(self) -> None:
        if not self.write:
            return
        text = DOC.read_text(encoding="utf-8")
        former = _table(text)
        rows = "\n".join([*former.splitlines()[:2], *_rows(self.results)])
        DOC.write_text(text.replace(former, rows), encoding="utf-8")


def _table(text: str) -> str:
    """Lines of the table in a page, with its two header lines."""
    return text[text.index(HEAD) :].split("\n\n")[0]


def _documented(table: str) -> dict[tuple[str, str], tuple[str, str, str]]:
    """Message, exit code and surviving data for each fault and link in the table."""
    results = dict[tuple[str, str], tuple[str, str, str]]()
    for row in table.splitlines()[2:]:
        message, faults, code, survives = row.removeprefix("| ").removesuffix(" |").split(" | ")
        for fault in faults.split("; "):
            name, links = fault.removesuffix(")").rsplit(" (", 1)
            results |= {(name, link): (message, code, survives) for link in links.split(" / ")}
    return results


def _rows(results: dict[tuple[str, str], tuple[str, str, str]]) -> list[str]:
    """One row for each result, with all faults and links that lead to it."""
    causes = dict[tuple[str, str, str], dict[str, list[str]]]()
    for (fault, link), result in results.items():
        causes.setdefault(result, {}).setdefault(fault, []).append(link)
    rows = list[str]()
    for (message, code, survives), faults in causes.items():
        cell = "; ".join(f"{fault} ({' / '.join(links)})" for fault, links in faults.items())
        rows.append(f"| {message} | {cell} | {code} | {survives} |")
    return rows


def _plain(message: str) -> str:
    """Replace the parts of a sentence that differ between runs: places and numbers."""
    message = re.sub(r"(serial|can|socket|sim)://\S+?(?=[:;,]? |$)", "LINK", message.removeprefix("dpr-lab: "))
    message = re.sub(r"\S+\.mcap", "FILE", message)
    message = re.sub(r"\b[0-9a-f]{8,16}\b", "N", message)
    message = re.sub(r"(/[\w.-]+){2,}", "PATH", message)
    message = re.sub(r"(?<![A-Za-z\d])[+-]?\d[\d,.]*(?<![,.])", "N", message).replace("|", "/")
    # A damaged frame can be counted under any of these, and can take its neighbour along.
    return re.sub(r"(?:(?:crc|framing) N, )+(?:tick_gap N, )?", "crc / framing / tick_gap N, ", message)


@pytest.fixture(scope="session")
def matrix() -> Iterator[Matrix]:
    made = Matrix()
    yield made
    made.close()
