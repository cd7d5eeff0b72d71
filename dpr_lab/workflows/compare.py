"""Compare runs with a model: figures and a report."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import IdentificationError, RunError
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.events import OnEvent, RunCompared, RunLeftOut, ignore

if TYPE_CHECKING:
    from dpr_lab.identification.moving_arm.identify import AnyComparison
    from dpr_lab.identification.moving_arm.model import AnyModel
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class CompareRequest:
    """Options of a comparison."""

    runs: tuple[Path, ...]
    model: Path
    """Identified model."""
    out: Path | None
    """Folder of figures and report; None: only the numbers are computed."""
    leave_out: bool = False
    """Whether runs that cannot be compared are skipped."""
    record: Path | None = None
    """File for the output of `compare --json`."""
    torque: str | None = None
    """`measured` or `commanded`: torques to use for runs that contain both; None: measured."""
    any_clock: bool = False
    """Whether to accept runs of a device whose clock rate error is larger than that of a crystal."""


@dataclass(frozen=True, slots=True)
class CompareResult:
    """Runs compared with the model."""

    comparisons: "tuple[AnyComparison, ...]"
    left_out: tuple[Path, ...]
    saved: dict[str, Any]
    """Output of `compare --json`."""


def compare(request: CompareRequest, on_event: OnEvent = ignore) -> CompareResult:
    """Compare runs with a model.

    If the arm moves, only segments are compared. The angles are then also written to the folder, as `comparison.csv`.

    Events: `RunRead`, `RunCompared`, `RunLeftOut`.

    Raises:
        ConfigError: a file with the name of the folder exists.
        RunError: the model cannot be read, or is a model of a moving arm and no folder is given; two runs contain the
            same recording; a run cannot be compared or, with `leave_out`, no run can be compared.
    """
    from dpr_lab.estimation.usable_runs import refuse_repeated
    from dpr_lab.identification.compare import compare_run
    from dpr_lab.identification.moving_arm.model import MovingArmModel, load_model
    from dpr_lab.report.saving import save_comparison, write_json
    from dpr_lab.workflows.compare_run import compare_arm_run

    if request.out is not None:
        check_folder_writable(request.out)
    model = load_model(request.model)
    if request.out is None and isinstance(model, MovingArmModel):
        raise RunError(f"{request.model}: is a model of a moving arm, but a second curve needs one of a clamped arm")
    recorded: list[tuple[Path, Run, Rig]] = []
    comparisons: list[AnyComparison] = []
    left_out: list[Path] = []
    for file in request.runs:
        with _leaving_out(file, request, left_out, on_event):
            recorded.append((file, *_read(file, model, request, on_event)))
    refuse_repeated([run for _, run, _ in recorded])
    for file, run, rig in recorded:
        with _leaving_out(file, request, left_out, on_event):
            if isinstance(model, MovingArmModel):
                comparisons.append(compare_arm_run(run, rig, model))
            else:
                comparisons.append(compare_run(run, rig, model))
            on_event(RunCompared(comparisons[-1]))
    if not comparisons:
        without = f"skipped: {', '.join(file.stem for file in left_out)}"
        raise RunError(f"no run can be compared ({without}): choose other runs")
    saved = save_comparison(model, comparisons, request.out) if request.out is not None else {}
    if request.record is not None:
        write_json(saved, request.record)
    return CompareResult(tuple(comparisons), tuple(left_out), saved)


@contextmanager
def _leaving_out(file: Path, request: CompareRequest, left_out: list[Path], on_event: OnEvent) -> Iterator[None]:
    """Add a run that cannot be read or compared to `left_out`, if the request permits it."""
    try:
        yield
    except (RunError, IdentificationError) as error:
        if not request.leave_out:
            raise
        left_out.append(file)
        on_event(RunLeftOut(file, str(error)))


def _read(file: Path, model: "AnyModel", request: CompareRequest, on_event: OnEvent) -> "tuple[Run, Rig]":
    """Read a run and its rig, with the length and gravity of the model.

    Raises:
        RunError: the run cannot be read, or the model belongs to another rig.
    """
    from dpr_lab.storage.reader import stored_rig
    from dpr_lab.workflows.reading import read_runs

    rig = stored_rig(file)
    if rig.name != model.rig.name:
        raise RunError(
            f"{file}: run of rig {rig.name}, but the model belongs to {model.rig.name}: give a model of this rig"
        )
    rig = rig.model_copy(update={"rig": rig.rig.model_copy(update={"L1": model.rig.L1, "g": model.rig.g})})
    (run,) = read_runs([file], rig, on_event, request.any_clock, request.torque)
    return run, rig
