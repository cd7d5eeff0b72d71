"""What the operator works on, kept from one start of the bench screen to the next."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import platformdirs
from pydantic import TypeAdapter

FILE = "bench.json"


def state_folder() -> Path:
    """Where the bench is kept; the environment variable DPR_LAB_STATE overrides the user's own folder."""
    return Path(os.environ.get("DPR_LAB_STATE") or platformdirs.user_state_dir("dpr-lab"))


@dataclass(slots=True)
class Bench:
    """What the operator works on."""

    rig: str = "paper"
    """Rig file, or the name of a built-in one."""
    link: str = ""
    """URL of the device; empty for the rig file's."""
    out: Path = field(default_factory=lambda: Path("bench"))
    """Folder that holds runs/, model.json, report/ and diagnosis/."""
    runs: list[Path] = field(default_factory=list)
    """Run files selected for identification."""
    held_out: list[Path] = field(default_factory=list)
    """Run files that only measure how far a diagnosis closes the gap."""
    model: Path | None = None
    diagnosis: Path | None = None
    theme: str = "dpr-dark"
    step: str = ""
    """Name of the step shown last."""

    def save(self, folder: Path) -> None:
        """Write it as JSON, whole or not at all."""
        folder.mkdir(parents=True, exist_ok=True)
        fresh = folder / f"{FILE}.new"
        fresh.write_bytes(_BENCH.dump_json(self, indent=1))
        fresh.replace(folder / FILE)


_BENCH = TypeAdapter(Bench)


def load(folder: Path) -> tuple[Bench, list[str]]:
    """The bench as it was left, and notices about what is not as it was.

    A damaged file means a fresh start; a run, model or diagnosis that is gone is dropped. Never raises.
    """
    path = folder / FILE
    try:
        bench = _BENCH.validate_json(path.read_bytes())
    except FileNotFoundError:
        return Bench(), []
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        return Bench(), [f"{path}: cannot be used ({reason}): the bench starts fresh"]
    return bench, _drop_missing(bench)


def _drop_missing(bench: Bench) -> list[str]:
    gone = list(dict.fromkeys(run for run in (*bench.runs, *bench.held_out) if not run.is_file()))
    bench.runs = [run for run in bench.runs if run not in gone]
    bench.held_out = [run for run in bench.held_out if run not in gone]
    if bench.model is not None and not bench.model.is_file():
        gone.append(bench.model)
        bench.model = None
    if bench.diagnosis is not None and not bench.diagnosis.exists():
        gone.append(bench.diagnosis)
        bench.diagnosis = None
    return [f"{path}: is gone, so it was dropped from the bench" for path in gone]
