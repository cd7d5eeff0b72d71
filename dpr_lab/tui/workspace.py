"""State of the operator's work, which is saved between sessions of the screen."""

import hashlib
import os
import tomllib
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import platformdirs
from pydantic import TypeAdapter, ValidationError

from dpr_lab.configs import find_config, key_words
from dpr_lab.errors import ConfigError
from dpr_lab.report.angles import UNITS, AngleUnit

FILE = "bench.json"
RECENT = 5
"""Maximum number of remembered rigs and folders."""
UNSAVED = (
    "the next session will not remember the current rig, link and runs (runs and results are kept): free"
    " disk space, or set another folder in DPR_LAB_STATE"
)

FRESH = "the screen starts with an empty workspace; choose rig, link and runs again (recordings and results are kept)"


def state_folder() -> Path:
    """Return the folder of the saved workspace.

    It is DPR_LAB_STATE or, if this is not set, the user's state folder.
    """
    return Path(os.environ.get("DPR_LAB_STATE") or platformdirs.user_state_dir("dpr-lab"))


@dataclass(slots=True)
class Workspace:
    """State of the operator's session: rig, link, folder and results."""

    rig: str = "paper"
    """Rig file, or the name of a built-in one."""
    link: str = ""
    """URL of the device; empty: the link of the rig file."""
    out: Path = field(default_factory=lambda: Path("bench"))
    """Folder that contains runs/, model.json, report/ and diagnosis/."""
    runs: list[Path] = field(default_factory=list)
    """Run files selected for identification."""
    recent_rigs: list[str] = field(default_factory=list)
    """Recently used rig files, the latest first."""
    recent_folders: list[Path] = field(default_factory=list)
    """Recently shown folders of runs, the latest first."""
    torque: str = ""
    """Torques used for runs that contain both kinds: `commanded`, or empty for measured."""
    held_out: list[Path] = field(default_factory=list)
    """Held-out run files, which only validate a diagnosis."""
    next_pose: str = ""
    """Planned pose for the next capture; empty: the pose that is selected in Capture."""
    next_duration_s: float = 10.0
    """Planned duration of the next capture, s."""
    undecided: Path | None = None
    """Recorded run that was neither kept nor repeated."""
    model: Path | None = None
    """File of the last identified model."""
    diagnosis: Path | None = None
    """File of the last diagnosis."""
    made_from: dict[str, dict[str, str]] = field(default_factory=dict)
    """Inputs of the result of each step, by kind, as returned by `basis`."""
    took: dict[str, float] = field(default_factory=dict)
    """Duration of the last job of each step, divided by its number of runs, s."""
    theme: str = "dpr-dark"
    angles: str = "degrees"
    """Unit of displayed angles (`dpr_lab.report.angles`)."""
    step: str = ""
    """Name of the last step."""

    @property
    def unit(self) -> AngleUnit:
        """Unit of displayed angles."""
        return UNITS.get(self.angles, UNITS["degrees"])

    @property
    def both_torques(self) -> bool:
        """Whether a selected run contains measured and commanded torques."""
        return any(map(_holds_both, (*self.runs, *self.held_out)))

    @property
    def driven_by(self) -> str | None:
        """`commanded` if commanded torques are selected and a run contains both kinds of torques; otherwise None."""
        return (self.torque or None) if self.both_torques else None

    def basis(self) -> dict[str, str]:
        """Return the inputs that results are computed from, by kind."""
        return {
            "the rig": _rig_stamp(self.rig),
            "the runs": " ".join(sorted(map(str, self.runs))),
            "the held-out runs": " ".join(sorted(map(str, self.held_out))),
            "the model": _stamp(self.model) if self.model is not None else "",
            "the torques": self.driven_by or "",
        }

    def move_to(self, out: Path) -> None:
        """Set the folder of the results.

        If this is another folder, runs and results are removed from the workspace.
        """
        if out == self.out.expanduser().resolve():
            return
        self.runs, self.held_out, self.undecided, self.model, self.diagnosis = [], [], None, None, None
        self.made_from, self.next_pose, self.step = {}, "", ""
        self.out = out

    def used(self, rig: str) -> None:
        """Add a rig file to the list of recent rig files."""
        self.recent_rigs = [rig, *(other for other in self.recent_rigs if other != rig)][:RECENT]

    def looked_at(self, folder: Path) -> None:
        """Add a folder to the list of recent folders."""
        self.recent_folders = [folder, *(other for other in self.recent_folders if other != folder)][:RECENT]

    def save(self, folder: Path) -> None:
        """Write the workspace as JSON, atomically.

        Raises:
            ConfigError: the folder cannot be written.
        """
        fresh = folder / f"{FILE}.new"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            fresh.write_bytes(_WORKSPACE.dump_json(self, indent=1))
            fresh.replace(folder / FILE)
        except OSError as error:
            raise ConfigError(f"{folder}: {error.strerror}: {UNSAVED}") from error


def _stamp(path: Path) -> str:
    return f"{path} {path.stat().st_mtime_ns}" if path.is_file() else str(path)


def _rig_stamp(rig: str) -> str:
    """Return a hash of a rig file without its poses, which affect no results.

    If the file cannot be read, return its time stamp instead.
    """
    try:
        path = find_config("rigs", rig)
        return _without_poses(path, path.stat().st_mtime_ns)
    except (ConfigError, OSError, ValueError):
        return _stamp(Path(rig))


@cache
def _without_poses(path: Path, mtime_ns: int) -> str:
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    table.pop("poses", None)
    return hashlib.sha256(repr(table).encode()).hexdigest()


@cache
def _holds_both(run: Path) -> bool:
    from dpr_lab.storage.inspect import holds_both_torques

    return holds_both_torques(run)  # a finished run is never changed


_WORKSPACE = TypeAdapter(Workspace)


def load(folder: Path) -> tuple[Workspace, list[str]]:
    """Return the saved workspace, and a notice for each problem.

    If the file is damaged, the workspace is empty. Missing runs, models and diagnoses are removed from the workspace.
    No exception is raised.
    """
    path = folder / FILE
    try:
        workspace = _WORKSPACE.validate_json(path.read_bytes())
    except FileNotFoundError:
        return Workspace(), []
    except ValidationError as error:
        fault = error.errors()[0]
        key = key_words(fault["loc"])
        damage = f"{key} = {str(fault['input'])[:60]} is not valid" if key else "the file is damaged"
        return Workspace(), [f"{path}: {damage}: {FRESH}"]
    except OSError as error:
        return Workspace(), [f"{path}: cannot be read ({error.strerror}): {FRESH}"]
    return workspace, _drop_missing(workspace)


def _drop_missing(workspace: Workspace) -> list[str]:
    """Remove missing files from the workspace; return a notice for each of them, except an undecided run."""
    results = [path for path in (workspace.model, workspace.diagnosis) if path is not None]
    gone = dict.fromkeys(path for path in (*workspace.runs, *workspace.held_out, *results) if not path.exists())
    workspace.runs = [run for run in workspace.runs if run not in gone]
    workspace.held_out = [run for run in workspace.held_out if run not in gone]
    for name in ("undecided", "model", "diagnosis"):
        if (path := getattr(workspace, name)) is not None and not path.exists():
            setattr(workspace, name, None)
    return [f"{path}: does not exist any more and was removed from the workspace" for path in gone]
