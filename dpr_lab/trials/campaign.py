"""Trials by the hundred: numbered cases, results kept line by line, so that a campaign goes on where it was killed.

campaign.json    what is tried; a folder holds one campaign
trials.jsonl     one line for each trial done
summary.json     what came out
.lock            held while a campaign runs
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from dpr_lab.errors import DprError, RunError
from dpr_lab.report.files import write_json
from dpr_lab.rig import load_rig
from dpr_lab.trials.case import run_case
from dpr_lab.trials.protocol import read_json
from dpr_lab.trials.score import TrialOutcome, read_outcome
from dpr_lab.trials.sealing import Kind, Level
from dpr_lab.trials.workers import Case, Done, on_cluster, on_this_machine
from dpr_lab.version import __version__

SETTINGS, TRIALS, LOCK = "campaign.json", "trials.jsonl", ".lock"


@dataclass(frozen=True, slots=True)
class Campaign:
    """Definition of a campaign: trial `number` hides `kinds[number % len(kinds)]`, drawn from `seed + number`."""

    kinds: tuple[Kind, ...]
    level: Level = Level.CLEAR
    seed: int = 1
    rig: str = "paper"
    """Rig file or built-in name that every rig is drawn around."""
    plant: str = "paper"
    """Plant file or built-in name; a file must lie where every worker finds it."""

    def cases(self, numbers: Sequence[int]) -> list[Case]:
        """Requests of the trials with these numbers, as JSON values.

        Raises:
            ConfigError: no such rig.
        """
        path = load_rig(self.rig).path
        assert path is not None
        common = {
            "level": self.level,
            "rig": path.read_text(encoding="utf-8"),
            "plant": self.plant,
            "version": __version__,
        }
        kinds = self.kinds
        return [{"number": i, "kind": kinds[i % len(kinds)], "seed": self.seed + i, **common} for i in numbers]


@dataclass(frozen=True, slots=True)
class Failure:
    """A trial that ended in an error; it is repeated when the campaign continues."""

    number: int
    error: str


@dataclass(frozen=True, slots=True)
class Tried:
    """Results of a campaign."""

    outcomes: tuple[TrialOutcome, ...]
    """In the order of their numbers."""
    failures: tuple[Failure, ...]


def run_campaign(
    campaign: Campaign,
    n: int,
    folder: Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    on_trial: Callable[[int, TrialOutcome | Failure | None], None] = lambda done, last: None,
) -> Tried:
    """Run the first `n` trials of a campaign, but for those that the folder holds already.

    Args:
        campaign: what to try
        n: how many in all
        folder: of the campaign; made, or gone on with
        jobs: processes on this machine
        scheduler: address of a dask scheduler to use instead
        on_trial: called at the start and after each with the number done and the last result

    Raises:
        RunError: the folder holds another campaign, or one that is running.
        DprError: a file cannot be written, or the workers are gone; what was done is kept.
    """
    with _alone(folder):
        _claim(folder, campaign)
        kept = {number: outcome for number, outcome in read_trials(folder).items() if number < n}
        failures: list[Failure] = []
        on_trial(len(kept), None)
        cases = campaign.cases([number for number in range(n) if number not in kept])
        for case, result in _done(cases, jobs, scheduler):
            if "error" in result:
                last = Failure(case["number"], result["error"])
                failures.append(last)
            else:
                _append(folder / TRIALS, {"number": case["number"], **result})
                last = kept[case["number"]] = read_outcome(result["outcome"])
            on_trial(len(kept) + len(failures), last)
        return Tried(tuple(kept[number] for number in sorted(kept)), tuple(failures))


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other processes out of a folder; the system lets go of it when a process is killed."""
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise RunError(f"{folder}: a campaign is running in it; wait for its end, or give another folder") from None
    except OSError as error:
        raise DprError(f"{folder}: cannot be written: {error.strerror}") from error
    try:
        yield
    finally:
        lock.release()


def _done(cases: list[Case], jobs: int, scheduler: str | None) -> Iterator[Done]:
    if not cases:
        return iter(())
    return on_this_machine(run_case, cases, jobs) if scheduler is None else on_cluster(run_case, cases, scheduler)


def _claim(folder: Path, campaign: Campaign) -> None:
    """Write down what is tried in a folder, or make sure that it is the same as before."""
    settings = json.loads(json.dumps(asdict(campaign))) | {"version": __version__}
    file = folder / SETTINGS
    if not file.exists():
        write_json(settings, file)
        return
    before = read_json(file)
    other = [name for name, value in settings.items() if before.get(name) != value]
    if other:
        was = ", ".join(f"{name} = {before.get(name)}" for name in other)
        raise RunError(f"{folder}: holds another campaign ({was}); go on with that one, or give another folder")


def read_trials(folder: Path) -> dict[int, TrialOutcome]:
    """The trials that a folder holds, by number. A line that a kill cut short is dropped from the file.

    Raises:
        RunError: a line that is whole is not a trial's.
    """
    file = folder / TRIALS
    if not file.is_file():
        return {}
    content = file.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    if whole != content:
        with file.open("r+b") as trials:
            trials.truncate(len(whole))
    outcomes: dict[int, TrialOutcome] = {}
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            kept = json.loads(line)
            outcomes[kept["number"]] = read_outcome(kept["outcome"])
        except (ValueError, KeyError, TypeError) as error:
            raise RunError(f"{file}: line {number} is not a trial: {error!r}; remove the line to repeat it") from error
    return outcomes


def _append(file: Path, line: dict[str, Any]) -> None:
    try:
        with file.open("ab") as trials:
            trials.write(json.dumps(line).encode() + b"\n")
    except OSError as error:
        raise DprError(f"{file}: cannot be written: {error.strerror}; run again to go on") from error
