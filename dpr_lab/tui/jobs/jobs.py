"""Functions that the screen runs in separate processes: workflows, and actions on single run files.

Large libraries are imported only in these processes, not in the process that draws the screen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.tui.jobs.job_control import JobControl
from dpr_lab.workflows.compare import CompareRequest
from dpr_lab.workflows.compare import compare as compare_runs
from dpr_lab.workflows.events import OnEvent
from dpr_lab.workflows.identify import IdentifyRequest, IdentifyResult
from dpr_lab.workflows.identify import identify as identify_runs

if TYPE_CHECKING:
    from dpr_lab.storage.inspect import RunInfo


def identify(control: JobControl, *, request: IdentifyRequest) -> IdentifyResult:
    """Identify a model.

    The search can be stopped with its best result so far.
    """
    return identify_runs(request, control.report, control.proceed)


def workflow(control: JobControl, *, job: Callable[[Any, OnEvent], Any], request: Any) -> Any:
    """Run a workflow with its request."""
    return job(request, control.report)


def compare(control: JobControl, *, request: CompareRequest) -> tuple[Path, ...]:
    """Compare runs with the model, and return the runs that cannot be compared."""
    return compare_runs(request, control.report).left_out


@dataclass(frozen=True, slots=True)
class RunSurveyed:
    """Metadata of a file in a folder of runs, or the reason why the file is unreadable."""

    path: Path
    info: "RunInfo | None"
    trouble: str = ""
    """Reason why the file is unreadable; otherwise empty."""


def survey(control: JobControl, *, paths: Sequence[Path]) -> None:
    """Read the metadata of run files one after the other."""
    from dpr_lab.errors import RunError
    from dpr_lab.storage.inspect import info

    for path in paths:
        try:
            control.report(RunSurveyed(path, info(path)))
        except RunError as error:
            control.report(RunSurveyed(path, None, str(error)))


def verify(control: JobControl, *, path: Path) -> str:
    """Check a run file like `dpr-lab run verify`, and return the result as text."""
    from dpr_lab.storage.inspect import unchanged
    from dpr_lab.storage.inspect import verify as verify_run

    checked = verify_run(path)
    return f"{path.name}: {unchanged(checked.interrupted) if checked.ok else '; '.join(checked.faults)}"


def recover(control: JobControl, *, path: Path, out: Path) -> str:
    """Recover a damaged run like `dpr-lab run recover`; return the sample count as text."""
    from dpr_lab.storage.inspect import recover as recover_run

    return f"{recover_run(path, out)} samples recovered: {out.name}"


def export(control: JobControl, *, path: Path, out: Path) -> str:
    """Export a run like `dpr-lab run export`; return the path as text."""
    from dpr_lab.storage.export import export as export_run
    from dpr_lab.storage.reader import load_run

    out.parent.mkdir(parents=True, exist_ok=True)
    return f"exported: {export_run(load_run(path), out)}"
