"""Campaigns of many numbered blind trials.

Each result is stored as one line when its trial ends, so that an interrupted campaign can be continued.

    campaign.json   definition of the campaign; a folder contains one campaign
    trials.jsonl    one line for each finished trial
    summary.json    scores
    .lock           file that is locked while the campaign runs
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout
from pydantic import ValidationError

from dpr_lab.configs import first_fault
from dpr_lab.errors import OutputError, RunError
from dpr_lab.report.plain import write_json
from dpr_lab.rig import load_rig
from dpr_lab.trials.case import run_case
from dpr_lab.trials.protocol import read_json
from dpr_lab.trials.score import TrialOutcome, read_outcome
from dpr_lab.trials.sealing import Kind, Level, TrialArm
from dpr_lab.trials.sequential import run_sequential_case
from dpr_lab.trials.workers import Case, Done, on_cluster, on_this_machine
from dpr_lab.version import __version__

SETTINGS, TRIALS, LOCK = "campaign.json", "trials.jsonl", ".lock"


@dataclass(frozen=True, slots=True)
class Campaign:
    """Definition of a campaign.

    The plant of trial `number` has the kind `kinds[number % len(kinds)]` and the seed `seed + number`.
    """

    kinds: tuple[Kind, ...]
    level: Level = Level.CLEAR
    seed: int = 1
    rig: str = "paper"
    """Rig file or built-in name of the rig about which the random rigs are drawn."""
    plant: str = "paper"
    """Plant file or built-in name of the plant about which the random plants are drawn; every worker reads it."""
    arm: TrialArm | None = None
    """Mode of the arm; None: the mode of the rig file."""
    strategies: tuple[str, ...] = ()
    """Names of the sequential strategies, keys of `STRATEGIES`.

    With strategies, each plant is recorded by each strategy, release by release, until the causes are decided.
    Without strategies, each plant is recorded once from each pose of the rig file.
    """

    def cases(self, numbers: Sequence[int]) -> list[Case]:
        """Return the cases of the trials with the given numbers, as JSON values.

        Raises:
            ConfigError: the rig is unknown.
        """
        path = load_rig(self.rig).path
        assert path is not None
        common = {
            "level": self.level,
            "rig": path.read_text(encoding="utf-8"),
            "plant": self.plant,
            "arm": self.arm,
            "version": __version__,
            **({"strategies": list(self.strategies)} if self.strategies else {}),
        }
        kinds = self.kinds
        return [{"number": i, "kind": kinds[i % len(kinds)], "seed": self.seed + i, **common} for i in numbers]


@dataclass(frozen=True, slots=True)
class Failure:
    """A trial that ended with an error. It is repeated when the campaign is continued."""

    number: int
    error: str


@dataclass(frozen=True, slots=True)
class CampaignTrials:
    """Results of a campaign."""

    outcomes: tuple[TrialOutcome, ...]
    """Results of the successful trials, in the order of their numbers."""
    failures: tuple[Failure, ...]


def run_campaign(
    campaign: Campaign,
    n: int,
    folder: Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    on_trial: Callable[[int, TrialOutcome | Failure | None], None] = lambda done, last: None,
) -> CampaignTrials:
    """Run the first `n` trials of a campaign that are not in the folder yet.

    Args:
        campaign: definition of the campaign
        n: total number of trials
        folder: folder of the campaign, which is created or continued
        jobs: number of processes on this machine
        scheduler: address of a dask scheduler that is used instead of these processes
        on_trial: function that is called at the start and after each trial with two arguments: the number of finished
            trials, and the last result or, at the start, None

    Raises:
        RunError: the folder contains another campaign, a campaign that is running, or an invalid trial.
        ConfigError: the rig is unknown.
        DprError: a file cannot be written, or the workers are lost; the results of finished trials are kept.
    """
    with _alone(folder):
        _claim(folder, campaign)
        finished = {number: outcome for number, outcome in read_trials(folder).items() if number < n}
        failures: list[Failure] = []
        on_trial(len(finished), None)
        cases = campaign.cases([number for number in range(n) if number not in finished])
        for case, result in _done(cases, jobs, scheduler):
            if "error" in result:
                last = Failure(case["number"], result["error"])
                failures.append(last)
            else:
                _append(folder / TRIALS, {"number": case["number"], **result})
                last = finished[case["number"]] = read_outcome(result["outcome"])
            on_trial(len(finished) + len(failures), last)
        return CampaignTrials(tuple(finished[number] for number in sorted(finished)), tuple(failures))


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Create a folder, and lock it against other processes; a killed process releases the lock."""
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise RunError(
            f"{folder}: a campaign is running in this folder; wait for its end, or give another folder"
        ) from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror}") from error
    try:
        yield
    finally:
        lock.release()


def _done(cases: list[Case], jobs: int, scheduler: str | None) -> Iterator[Done]:
    if not cases:
        return iter(())
    run = run_sequential_case if cases[0].get("strategies") else run_case
    return on_this_machine(run, cases, jobs) if scheduler is None else on_cluster(run, cases, scheduler)


def _claim(folder: Path, campaign: Campaign) -> None:
    """Write the definition of a campaign to a folder, or compare it with the definition in the folder.

    Raises:
        RunError: the folder contains another definition.
    """
    settings = json.loads(json.dumps(asdict(campaign))) | {"version": __version__}
    file = folder / SETTINGS
    if not file.exists():
        write_json(settings, file)
        return
    before = read_json(file)
    other = [name for name, value in settings.items() if before.get(name) != value]
    if other:
        was = ", ".join(f"{name} = {before.get(name)}" for name in other)
        raise RunError(f"{folder}: contains another campaign ({was}); continue that campaign, or give another folder")


def read_trials(folder: Path) -> dict[int, TrialOutcome]:
    """Read the outcomes of the trials in a folder, by number.

    An incomplete last line, which a killed process can leave, is removed from the file.

    Raises:
        RunError: a complete line is not a valid trial.
    """
    file = folder / TRIALS
    if not file.is_file():
        return {}
    content = file.read_bytes()
    complete_lines = content[: content.rfind(b"\n") + 1]
    if complete_lines != content:
        with file.open("r+b") as trials:
            trials.truncate(len(complete_lines))
    outcomes: dict[int, TrialOutcome] = {}
    for number, line in enumerate(complete_lines.splitlines(), 1):
        try:
            record = json.loads(line)
            outcomes[record["number"]] = read_outcome(record["outcome"])
        except (ValueError, KeyError, TypeError) as error:
            fault = first_fault(error) if isinstance(error, ValidationError) else repr(error)
            raise RunError(
                f"{file}: line {number} is not a trial: {fault}; remove the line to repeat the trial"
            ) from error
    return outcomes


def _append(file: Path, line: dict[str, Any]) -> None:
    try:
        with file.open("ab") as trials:
            trials.write(json.dumps(line).encode() + b"\n")
    except OSError as error:
        raise OutputError(f"{file}: cannot be written: {error.strerror}; run the command again to continue") from error
