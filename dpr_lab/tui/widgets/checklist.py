"""List of the poses with the number of their recordings, and the next pose."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from textual.content import Content

from dpr_lab.acquisition.capture import in_file_name
from dpr_lab.errors import RunError
from dpr_lab.storage.sidecar import note_of, sidecar_of

ASIDE = "aside"
"""Folder, next to the runs, for recordings that the operator repeated. Nothing is deleted."""


def kept(runs: Iterable[Path], poses: Iterable[str]) -> dict[str, int]:
    """Count the runs of each pose, which is a part of the file name."""
    names = [parts[1] for run in runs if len(parts := run.stem.split("_")) > 2]
    return {pose: names.count(in_file_name(pose)) for pose in poses}


def next_pose(done: Mapping[str, int], repeats: int, current: str) -> str:
    """Return the next pose to record.

    This is the current pose until it has enough runs, then the first incomplete pose.
    """
    if done.get(current, repeats) < repeats:
        return current
    return next((pose for pose, number in done.items() if number < repeats), current)


def checklist_text(done: Mapping[str, int], repeats: int, current: str) -> Content:
    """Return the list of the poses as text, with one line for each pose."""
    return Content("\n").join(_line(pose, number, repeats, pose == current) for pose, number in done.items())


def _line(pose: str, number: int, repeats: int, current: bool) -> Content:
    marks = "✔" * number + "○" * max(0, repeats - number)
    return Content.styled(f"{'▶' if current else ' '} {pose} {marks} {number} of {repeats}", "bold" if current else "")


def set_aside(run: Path) -> Path:
    """Move a run with hash and note to the set-aside folder; return its path.

    Raises:
        RunError: a file cannot be moved.
    """
    moved = run.parent / ASIDE / run.name
    try:
        moved.parent.mkdir(exist_ok=True)
        for file, target in ((sidecar_of(run), sidecar_of(moved)), (note_of(run), note_of(moved)), (run, moved)):
            if file.exists():
                file.replace(target)
    except OSError as error:
        raise RunError(f"{run}: cannot be moved to {moved.parent}: {error.strerror}; the run is not lost") from error
    return moved
