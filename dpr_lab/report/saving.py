"""Save results as files: figures, pages, models and exports."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from dpr_lab.acceptance.judge import Acceptance
from dpr_lab.errors import ConfigError, DprError, RunError
from dpr_lab.exports import FORMATS, ExportFormat
from dpr_lab.exports.corrected import corrected_model
from dpr_lab.exports.cost import REPLAY_RULE, ExportReference, Replayed, export_reference
from dpr_lab.exports.refit import fitted_for
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.moving_arm.identify import AnyComparison, ArmComparison
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.report.figures import by_kind, save_figures
from dpr_lab.report.gap.figures import save_gap_figures
from dpr_lab.report.gap.html import write_gap_report
from dpr_lab.report.html import write_arm_report, write_report
from dpr_lab.report.moving_arm import angles_csv
from dpr_lab.report.plain import write_json as write_json
from dpr_lab.report.words import named
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.whole_file import write_text, write_whole

AXES = ("theta1", "theta2")


def save_comparison(model: AnyModel, comparisons: Sequence[AnyComparison], out: Path) -> dict[str, Any]:
    """Write figures and report of a comparison, and return the output of `dpr-lab compare --json`.

    For a model of a moving arm, the angles are written as `comparison.csv`.

    Raises:
        DprError: the folder or a file cannot be written.
    """
    of_arm, of_rods = by_kind(comparisons)
    if isinstance(model, MovingArmModel):
        return _save_arm_comparison(model, of_arm, out)
    figures = save_figures(model, of_rods, out)
    report = write_report(model, of_rods, out, figures)
    return {
        "report": str(report),
        "figures": {name: str(path) for name, path in figures.items()},
        "runs": [_record(comparison) for comparison in of_rods],
    }


def _save_arm_comparison(model: MovingArmModel, compared: Sequence[ArmComparison], out: Path) -> dict[str, Any]:
    file = out / "comparison.csv"
    write_text(file, angles_csv(compared), RunError)
    keys = ("run", "held_out", "truncated", "segment_s", "rms_rad", "noise_rad")
    saved = {"file": str(file), "runs": [{key: getattr(comparison, key) for key in keys} for comparison in compared]}
    return saved | {"report": str(write_arm_report(model, compared, saved, out))}


def save_diagnosis(
    diagnosis: Diagnosis,
    runs: Sequence[Run],
    rig: Rig,
    out: Path,
    on_loss: Callable[[str], None] = lambda sentence: None,
    acceptance: Acceptance | None = None,
) -> dict[str, str]:
    """Write report, figures, corrected model and exports; return their paths by name.

    Args:
        diagnosis: the diagnosis
        runs: the diagnosed runs, without held-out runs
        rig: the rig
        out: the folder
        on_loss: function that is called with a sentence if a written model differs from the corrected model
        acceptance: results of limits; None if no limits were tested

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = save_gap_figures(diagnosis, out)
    report = write_gap_report(diagnosis, f"Rig “{rig.name}”: sim-to-real gap", out, figures, acceptance)
    corrected = _confirmed(diagnosis, corrected_model(diagnosis, runs, rig), runs, rig, on_loss)
    corrected.save(out / "model.json")
    exports = save_exports(corrected, runs, rig, out, on_loss)
    return {"report": str(report), "model": str(out / "model.json"), **exports}


def _confirmed(
    diagnosis: Diagnosis, corrected: AnyModel, runs: Sequence[Run], rig: Rig, on_loss: Callable[[str], None]
) -> AnyModel:
    """Return the bare model if no cause is confirmed and it predicts better; otherwise the corrected model.

    The predictions are free runs. If no run can be replayed, the corrected model is returned.
    """
    clamped = [run for run in runs if run.arm is None]
    if diagnosis.verdict != "unexplained" or not corrected.effects or not clamped:
        return corrected
    try:
        reference = export_reference(corrected, clamped, rig)
    except DprError:
        return corrected
    corrected_rad, bare_rad = reference.replayed(reference.own).off_rad, reference.bare_rad
    if corrected_rad <= REPLAY_RULE.worse * bare_rad:
        return corrected
    warning = (
        f"The corrected model predicts worse than the bare model ({1e3 * corrected_rad:.3g} against"
        f" {1e3 * bare_rad:.3g} mrad in free runs). Therefore the model files contain the bare model, without"
        f" {', '.join(map(named, corrected.effects))}."
    )
    on_loss(warning)
    return reference.bare.model_copy(update={"warnings": [*corrected.warnings, warning]})


def save_exports(
    corrected: AnyModel, runs: Sequence[Run], rig: Rig, out: Path, on_loss: Callable[[str], None]
) -> dict[str, str]:
    """Write the corrected model for other programs, and return the paths by the names of the formats.

    If a format cannot represent an effect, a simpler model is refitted. The bare model is written instead if it
    predicts better than this simpler model. See `save_diagnosis` for arguments and errors.
    """
    formats = [name for name, form in FORMATS.items() if not form.optional]
    models = fitted_for(formats, corrected, runs, rig)
    reference = None
    if any(model is not corrected for model in models.values()):
        reference = _reference_or_none(corrected, [run for run in runs if run.arm is None], rig, on_loss)
    exports: dict[str, str] = {}
    for name in formats:
        model, lost, check = models[name], FORMATS[name].lost(corrected, rig), None
        if reference is not None and model is not corrected:
            model, swings = reference.chosen_model(model)
            replayed = reference.replayed(swings)
            check = check_of(replayed, reference.bare_rad)
            errors = replayed.off_rad, reference.replayed(reference.own).off_rad, reference.bare_rad
            export_mrad, corrected_mrad, bare_mrad = (1e3 * error for error in errors)
            on_loss(
                f"{name}: refitted without {', '.join(map(named, lost))}; rms error of free runs up to the"
                f" predictability horizon {export_mrad:.3g} mrad (corrected model {corrected_mrad:.3g} mrad, bare"
                f" model {bare_mrad:.3g} mrad)"
            )
        try:
            exports[name] = write_export(FORMATS[name], model, rig, out, lost, check)
        except ConfigError as error:  # rigid bodies cannot represent this model
            on_loss(f"{name} was not written: {error}")
    return exports


def _reference_or_none(
    corrected: AnyModel, runs: Sequence[Run], rig: Rig, on_loss: Callable[[str], None]
) -> ExportReference | None:
    """Simulate the runs with the corrected and the bare model, as reference for the errors of exports.

    If no run can be replayed, `on_loss` is called and the result is None.
    """
    try:
        return export_reference(corrected, runs, rig)
    except DprError as error:
        on_loss(f"The URDF and SDFormat files contain refitted models whose error is unknown: {error}")
        return None


def check_of(replayed: Replayed, bare_rad: float) -> dict[str, float]:
    """Return the errors of an export and of the bare model, for the JSON file of the export."""
    return {"off_rad": replayed.off_rad, "closed": replayed.closed, "bare_rad": bare_rad}


def write_export(
    export_format: ExportFormat,
    model: AnyModel,
    rig: Rig,
    out: Path,
    lost: Mapping[str, str],
    check: Mapping[str, Any] | None = None,
) -> str:
    """Write a model for another program, and return the path of its main file.

    See `ExportFormat.written` for the arguments.

    Raises:
        DprError: the folder or a file cannot be written, or a package of the format is not installed.
    """
    for file, content in export_format.written(model, rig, lost, check).items():
        encoded = content if isinstance(content, bytes) else content.encode("utf-8")
        write_whole(out / file, partial(Path.write_bytes, data=encoded))
    return str(out / export_format.main)


def _record(comparison: Comparison) -> dict[str, Any]:
    by_axis, rods = ("segment_rms_rad", "free_run_rms_rad", "noise_rad"), AXES[: comparison.rods]
    return {
        "run": comparison.run,
        "pose": comparison.pose,
        "held_out": comparison.held_out,
        "truncated": comparison.truncated,
        **({"torque_kind": comparison.torque_kind} if comparison.torque_kind else {}),
        "horizon_s": comparison.horizon_s,
        "segments": comparison.segments,
        **{name: dict(zip(rods, getattr(comparison, name).tolist(), strict=False)) for name in by_axis},
    }
