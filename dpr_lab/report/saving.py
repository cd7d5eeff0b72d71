"""Results as files: the same figures, page and JSON whether a command or the bench screen asks for them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dpr_lab.compare import Comparison
from dpr_lab.gap.corrected import corrected_model
from dpr_lab.gap.diagnosis import Diagnosis
from dpr_lab.gap.export import mjcf, python_module
from dpr_lab.model import Model
from dpr_lab.report.figures import save_figures
from dpr_lab.report.files import write_json as write_json
from dpr_lab.report.files import write_to
from dpr_lab.report.gap_figures import save_gap_figures
from dpr_lab.report.gap_html import write_gap_report
from dpr_lab.report.html import write_report
from dpr_lab.rig import Rig
from dpr_lab.run import Run

AXES = ("theta1", "theta2")


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


def save_diagnosis(found: Diagnosis, runs: Sequence[Run], rig: Rig, out: Path) -> dict[str, str]:
    """Write report, figures, corrected model and its exports; their paths by name.

    Args:
        found: the diagnosis
        runs: what was diagnosed, without what was held out
        rig: the rig
        out: the folder

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = save_gap_figures(found, out)
    report = write_gap_report(found, f"Double pendulum “{rig.name}”: why simulation and rig differ", out, figures)
    corrected = corrected_model(found, runs, rig)
    corrected.save(out / "model.json")
    exports = {"module": (out / "corrected_model.py", python_module), "mjcf": (out / "corrected_model.xml", mjcf)}
    for path, make in exports.values():
        text = make(corrected, rig)
        write_to(path, lambda file, text=text: file.write_text(text, encoding="utf-8"))
    return {
        "report": str(report),
        "model": str(out / "model.json"),
        **{name: str(path) for name, (path, _) in exports.items()},
    }


def _record(comparison: Comparison) -> dict[str, Any]:
    by_axis = ("segment_rms_rad", "free_run_rms_rad", "noise_rad")
    return {
        "run": comparison.run,
        "pose": comparison.pose,
        "held_out": comparison.held_out,
        "horizon_s": comparison.horizon_s,
        "segments": comparison.segments,
        **{name: dict(zip(AXES, getattr(comparison, name).tolist(), strict=True)) for name in by_axis},
    }
