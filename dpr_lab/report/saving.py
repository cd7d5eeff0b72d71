"""Results as files: the same figures, page and JSON whether a command or the bench screen asks for them."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from dpr_lab.errors import DprError
from dpr_lab.exports import FORMATS, ExportFormat
from dpr_lab.exports.corrected import corrected_model
from dpr_lab.exports.cost import Replayed, Yardstick, yardstick
from dpr_lab.exports.refit import fitted_for
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.model import Model
from dpr_lab.report.figures import save_figures
from dpr_lab.report.files import write_json as write_json
from dpr_lab.report.gap.figures import save_gap_figures
from dpr_lab.report.gap.html import write_gap_report
from dpr_lab.report.html import write_report
from dpr_lab.report.words import named
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.whole_file import write_whole

AXES = ("theta1", "theta2")

BINARY = ("fmu", "fmu2")
"""Formats that a diagnosis does not write by itself: they need what not every lab has installed."""


def save_comparison(model: Model, comparisons: Sequence[Comparison], out: Path) -> dict[str, Any]:
    """Write figures and report of a comparison; what `dpr-lab compare --json` prints.

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = save_figures(model, comparisons, out)
    report = write_report(model, comparisons, out, figures)
    return {
        "report": str(report),
        "figures": {name: str(path) for name, path in figures.items()},
        "runs": [_record(comparison) for comparison in comparisons],
    }


def save_diagnosis(
    found: Diagnosis, runs: Sequence[Run], rig: Rig, out: Path, on_loss: Callable[[str], None] = lambda sentence: None
) -> dict[str, str]:
    """Write report, figures, corrected model and its exports; their paths by name.

    Args:
        found: the diagnosis
        runs: what was diagnosed, without what was held out
        rig: the rig
        out: the folder
        on_loss: told what a program cannot say, and what that costs

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = save_gap_figures(found, out)
    report = write_gap_report(found, f"Double pendulum “{rig.name}”: why simulation and rig differ", out, figures)
    corrected = corrected_model(found, runs, rig)
    corrected.save(out / "model.json")
    exports = save_exports(corrected, runs, rig, out, on_loss)
    return {"report": str(report), "model": str(out / "model.json"), "module": exports["python"], **exports}


def save_exports(
    corrected: Model, runs: Sequence[Run], rig: Rig, out: Path, on_loss: Callable[[str], None]
) -> dict[str, str]:
    """Write the corrected model for other programs: simpler where one cannot say it, but not worse than the bare model.

    Arguments and errors as of `save_diagnosis`.
    """
    formats = [name for name in FORMATS if name not in BINARY]
    models = fitted_for(formats, corrected, runs, rig)
    beside = None
    if any(item is not corrected for item in models.values()):
        beside = _yardstick(corrected, [run for run in runs if run.arm is None], rig, on_loss)
    exports: dict[str, str] = {}
    for name in formats:
        model, lost, check = models[name], FORMATS[name].lost(corrected, rig), None
        if beside is not None and model is not corrected:
            model, swings = beside.held_against(model)
            tried = beside.replayed(swings)
            check = check_of(tried, beside.bare_rad)
            off, own, bare = (
                1e3 * each for each in (tried.off_rad, beside.replayed(beside.own).off_rad, beside.bare_rad)
            )
            on_loss(
                f"{name}: without {', '.join(map(named, lost))}; off by {off:.3g} mrad on these runs, the corrected"
                f" model by {own:.3g}, the bare model by {bare:.3g}"
            )
        exports[name] = write_export(FORMATS[name], model, rig, out, lost, check)
    return exports


def _yardstick(corrected: Model, runs: Sequence[Run], rig: Rig, on_loss: Callable[[str], None]) -> Yardstick | None:
    """None, and a sentence, where no run can be replayed: an arm that moves, a swing that no start state comes near."""
    try:
        return yardstick(corrected, runs, rig)
    except DprError as error:
        on_loss(f"what URDF and SDFormat cannot say was fitted again, what that costs is not known: {error}")
        return None


def check_of(tried: Replayed, bare_rad: float) -> dict[str, float]:
    """What an export says beside its losses of how it does."""
    return {"off_rad": tried.off_rad, "closed": tried.closed, "bare_rad": bare_rad}


def write_export(
    made: ExportFormat,
    model: Model,
    rig: Rig,
    out: Path,
    lost: Mapping[str, str],
    check: Mapping[str, Any] | None = None,
) -> str:
    """Write a model for another program; arguments as of `ExportFormat.written`. The file that is read first.

    Raises:
        DprError: the folder or a file cannot be written, or what the format needs is not installed.
    """
    for file, content in made.written(model, rig, lost, check).items():
        data = content if isinstance(content, bytes) else content.encode("utf-8")
        write_whole(out / file, partial(Path.write_bytes, data=data))
    return str(out / made.main)


def _record(comparison: Comparison) -> dict[str, Any]:
    by_axis = ("segment_rms_rad", "free_run_rms_rad", "noise_rad")
    return {
        "run": comparison.run,
        "pose": comparison.pose,
        "held_out": comparison.held_out,
        **({"torque_kind": comparison.torque_kind} if comparison.torque_kind else {}),
        "horizon_s": comparison.horizon_s,
        "segments": comparison.segments,
        **{name: dict(zip(AXES, getattr(comparison, name).tolist(), strict=True)) for name in by_axis},
    }
