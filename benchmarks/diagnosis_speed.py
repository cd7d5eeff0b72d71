"""CPU time and memory of a diagnosis with the current code and with another commit, on the same recordings.

Both versions must give the same results.

    python benchmarks/diagnosis_speed.py --against COMMIT [--cases 60] [--seed S] [--quick] [--json]

The other commit is checked out as a git worktree in a temporary folder. Blind trials are drawn and recorded once, with
the current code. Two processes, one for each version, read the recordings from files and diagnose them alternately.
Each process uses one thread and its own kernels, which are compiled before the measurement. A measurement during which
code was compiled is repeated. Times are CPU seconds inside `diagnose`. A ratio is the time of the current code divided
by the time of the other commit for the same trial, so that other load on the machine has little influence.

Six recordings of 30 s at 1 kHz are compared with three recordings of 10 s of the same plant at the rate of the rig
file. Their memory is the maximum of a process that does nothing else. `identify` uses three recordings of 10 s at 200
Hz. With --quick, there are three trials and no long recordings.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _bars import Bar, at_least, at_most, options, show
from _trial_cases import THREADS, Case, hidden

from dpr_lab.rig import Rig
from dpr_lab.run import Run
from sim_device.trials.offline_recorder import record

ROOT = Path(__file__).parents[1]

DRAWS = (
    "single:clear",
    "single:clear:arm_compliance",
    "pair:clear",
    "clean",
    "outside:clear:tuning",
    "single:subtle",
    "triple:clear",
    "dirty:clear",
    "single:clear",
    "pair:clear:arm_compliance,coulomb_joint2",
    "form:clear:tuning",
    "single:clear:backlash_joint2",
    "pair:clear",
    "single:clear",
    "single:clear:hysteresis_joint1",
)
"""Draw specifications through which the trials cycle."""

FIRST_SEED = 700_000
QUICK = 3
SEARCHES = 3
"""Number of seeds with which `identify` is measured."""
IDENTIFY_HZ = 200
"""Sample rate of the recordings for `identify`, Hz, as in benchmarks/wall_time.py."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Trial that was diagnosed by both versions of the code."""

    draw: str
    seed: int
    now: dict[str, Any]
    then: dict[str, Any]

    @property
    def ratio(self) -> float:
        """CPU time of the current code divided by that of the other commit."""
        return self.now["cpu_s"] / self.then["cpu_s"]

    @property
    def alike(self) -> bool:
        """Whether both versions give the same verdict and the same named effects."""
        return all(self.now[key] == self.then[key] for key in ("verdict", "names"))


def keep(folder: Path, runs: Sequence[Run], rig: Rig) -> Path:
    """Write runs and rig as files that every version of dpr-lab can read."""
    folder.mkdir(parents=True)
    arrays = {f"{name}{i}": getattr(run, name) for i, run in enumerate(runs) for name in ("t", "theta", "counts")}
    np.savez(folder / "runs.npz", **arrays)
    about = [{"name": run.name, "pose": run.pose, "rate_hz": run.rate_hz} for run in runs]
    text = json.dumps({"rig": rig.model_dump(mode="json", exclude_defaults=True), "runs": about})
    (folder / "case.json").write_text(text, encoding="utf-8")
    return folder


class CodeBase:
    """Process that runs the code of one folder."""

    def __init__(self, code: Path, cache: Path) -> None:
        threads = dict.fromkeys(THREADS, "1")
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("_timed_child.py"))],
            env={**os.environ, **threads, "PYTHONPATH": str(code), "NUMBA_CACHE_DIR": str(cache)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, do: str, folder: Path, seed: int = 0) -> dict[str, Any]:
        """Execute a request. Repeat it if code was compiled meanwhile."""
        result = self._asked(do, folder, seed)
        return self._asked(do, folder, seed) if result["compiled"] else result

    def _asked(self, do: str, folder: Path, seed: int) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps({"do": do, "folder": str(folder), "seed": seed}), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit("the measuring process ended; its messages are printed above")
        return json.loads(line)

    def __enter__(self) -> "CodeBase":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()


@contextmanager
def checked_out(commit: str, folder: Path) -> Iterator[Path]:
    """Context manager for a worktree of a commit, which is removed at the end."""
    subprocess.run(["git", "-C", ROOT, "worktree", "add", "--quiet", "--detach", folder, commit], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", folder], check=True)


def compared(now: CodeBase, then: CodeBase, cases: Sequence[Case], folder: Path) -> Iterator[Pair]:
    """Diagnose every trial with both versions, which take turns in running first."""
    for number, case in enumerate(cases):
        plant, rig = hidden(case)
        kept = keep(folder / str(number), record(plant, rig), rig)
        order = (now, then) if number % 2 == 0 else (then, now)
        outcome = {side: side.ask("diagnose", kept) for side in order}
        pair = Pair(case.draw, case.seed, outcome[now], outcome[then])
        result = "" if pair.alike else f"  {pair.now['names']} instead of {pair.then['names']}"
        seconds = f"{pair.now['cpu_s']:7.2f} s {pair.then['cpu_s']:7.2f} s {pair.ratio:6.3f}"
        print(f"{seconds}  {case.seed} {case.draw}{result}", file=sys.stderr, flush=True)
        yield pair


def warmed(sides: Sequence[CodeBase], folder: Path) -> Path:
    """Let both versions compile all kernels that they need.

    Returns a folder with three recordings of 10 s without effects.
    """
    plant, rig = hidden(Case("warm up", "pair:clear:arm_compliance,coulomb_joint2", FIRST_SEED - 1))
    short = keep(folder / "arm", record(plant, rig, duration=2.0)[:2], rig)
    plant, rig = hidden(Case("warm up", "clean", FIRST_SEED - 2))
    clean = keep(folder / "clean", record(plant, rig, rate_hz=IDENTIFY_HZ), rig)
    for side in sides:
        side.ask("diagnose", short)
        side.ask("identify", clean)
    return clean


def trial_bars(pairs: Sequence[Pair]) -> list[Bar]:
    """Results for the trials."""
    ratios, now, then = (
        [pair.ratio for pair in pairs],
        [pair.now["cpu_s"] for pair in pairs],
        [pair.then["cpu_s"] for pair in pairs],
    )
    return [
        at_most("CPU of a diagnosis, now / then, median", statistics.median(ratios), 0.2),
        Bar("the same, longest", "-", max(ratios), None),
        Bar("CPU now, median, s", "-", statistics.median(now), None),
        at_most("CPU now, longest, s", max(now), 12.0),
        Bar("CPU then, median, s", "-", statistics.median(then), None),
        Bar("CPU then, longest, s", "-", max(then), None),
        at_least("verdict and names alike, %", 100 * sum(pair.alike for pair in pairs) / len(pairs), 100.0),
    ]


def identify_bars(now: CodeBase, then: CodeBase, clean: Path) -> list[Bar]:
    """Results for the identification of three recordings of 10 s."""
    taken = [[side.ask("identify", clean, seed)["cpu_s"] for side in (now, then)] for seed in range(SEARCHES)]
    seconds, ratios = [mine for mine, _ in taken], [mine / other for mine, other in taken]
    return [
        at_most("identify, three 10 s runs at 200 Hz, one thread, s", statistics.median(seconds), 0.6),
        Bar("the same, now / then", "-", statistics.median(ratios), None),
    ]


def long_bars(cache: Path, folder: Path) -> list[Bar]:
    """Results for six recordings of 30 s at 1 kHz, which a separate process diagnoses."""
    plant, rig = hidden(Case("long", "single:clear:coulomb_joint1", FIRST_SEED - 3))
    few = keep(folder / "few", record(plant, rig), rig)
    twice = rig.model_copy(update={"poses": rig.poses | {f"{name} again": pose for name, pose in rig.poses.items()}})
    many = keep(folder / "many", record(plant, twice, duration=30.0, rate_hz=1000), twice)
    with CodeBase(ROOT, cache) as alone:
        alone.ask("diagnose", few)  # loads what was compiled
        short, long = alone.ask("diagnose", few), alone.ask("diagnose", many)
    return [
        at_most("CPU, 6 runs of 30 s at 1 kHz / 3 runs of 10 s", long["cpu_s"] / short["cpu_s"], 7.0),
        at_most("their memory, MB", long["peak_mb"], 500.0),
    ]


def main() -> None:
    """Measure both versions and print the results."""
    parser = options(__doc__)
    parser.add_argument("--against", required=True, metavar="COMMIT", help="the commit to compare with")
    parser.add_argument("--cases", type=int, default=60, help="blind trials")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="seed of the first trial")
    chosen = parser.parse_args()
    count = min(QUICK, chosen.cases) if chosen.quick else chosen.cases
    cases = [Case("speed", DRAWS[i % len(DRAWS)], chosen.seed + i) for i in range(count)]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="diagnosis-speed-")))
        other = stack.enter_context(checked_out(chosen.against, folder / "then"))
        now = stack.enter_context(CodeBase(ROOT, folder / "cache_now"))
        then = stack.enter_context(CodeBase(other, folder / "cache_then"))
        clean = warmed([now, then], folder / "warm")
        pairs = list(compared(now, then, cases, folder / "cases"))
        bars = trial_bars(pairs) + identify_bars(now, then, clean)
        bars += [] if chosen.quick else long_bars(folder / "cache_now", folder / "long")
    show(f"diagnosis against {chosen.against}", bars, chosen.json, trials=[asdict(pair) for pair in pairs])


if __name__ == "__main__":
    main()
