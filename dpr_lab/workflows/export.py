"""Export of a model to other programs, with a replay in each program."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import RunError, refuse_unknown
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.events import OnEvent, StageBegan, Warned, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.exports.cost import Replayed
    from dpr_lab.identification.moving_arm.model import AnyModel
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class ExportResult:
    """Written files and the error of the exported model."""

    files: dict[str, str]
    """Main file of each format, which the program of the format reads."""
    lost: dict[str, dict[str, str]]
    """Effects that each format cannot express, with the reason for each effect."""
    instead: dict[str, list[str]]
    """Effects of the refitted model of each format."""
    refused: dict[str, str]
    """Reason for each format whose file was not written."""
    bare_rad: float | None
    """Error of the bare model on the replayed runs, rad; None: no runs were replayed."""
    lab: "Replayed | None"
    """Errors of the model in dpr-lab's own simulation; None: no runs were replayed."""
    tried: "dict[str, Replayed]"
    """Errors of the model in the program of each format."""
    torques: tuple[str, ...]
    """Kinds of the known torques that drove the runs."""
    scale: dict[str, Any] | None
    """Scale of masses, inertias and torques: the assumed inertia (`b`, kg m^2), its 90 % interval, its source, and its
    name (`inertia`; a if only the inner rod is mounted). None: unknown."""
    scale_sentence: str
    """Sentence that describes the scale."""
    has_effects: bool
    """Whether the model contains effects. A model without effects cannot close the gap."""

    def to_json(self) -> dict[str, Any]:
        """Return the output of `dpr-lab export --json`."""
        return {"schema": 1, **asdict(self)}


def export(
    model_path: Path,
    rig_name: str,
    formats: Sequence[str],
    out: Path,
    check: Sequence[Path] = (),
    torque: str | None = None,
    on_event: OnEvent = ignore,
) -> ExportResult:
    """Export a model.

    Runs to check are replayed in each program, and exports that are worse than the bare model are refused.

    Args:
        model_path: model written by `identify` or `diagnose`, or the folder of a diagnosis
        rig_name: rig file, or the name of a built-in one
        formats: names of the formats
        out: folder of the files
        check: runs to replay in each program. Models for formats that cannot express an effect are refitted to these
            runs.
        torque: `measured` or `commanded`: torques to use for runs that contain both; None: measured
        on_event: receives `RunRead`, `StageBegan` and `Warned`

    Raises:
        ConfigError: the rig is not valid, the format is unknown, or a package of the format is not installed.
        RunError: the model or a run cannot be used.
        DprError: a file cannot be written, or a program did not run.
    """
    from dpr_lab.exports import FORMATS
    from dpr_lab.exports.refit import fitted_for, moving, moving_losses
    from dpr_lab.identification.moving_arm.model import MovingArmModel
    from dpr_lab.report.saving import check_of, write_export
    from dpr_lab.rig import load_rig
    from dpr_lab.run import torque_kinds

    refuse_unknown(formats, FORMATS, "format")
    check_folder_writable(out)
    rig = load_rig(rig_name)
    model = model_to_write(model_path, rig, on_event)
    runs = read_runs(check, rig, on_event, torque=torque, moving=isinstance(model, MovingArmModel))
    warn_of_one_rod(model, rig, on_event)
    for run in runs:
        if run.arm is not None:
            raise RunError(f"{run.name}: its arm moves, which the replay does not support: check another run")
    lost = {name: FORMATS[name].lost(model, rig) for name in formats}
    models = fitted_for(formats, model, runs, rig) if runs else dict.fromkeys(formats, model)
    for name in formats if not runs else ():
        if moving_losses(name, model, rig):
            on_event(
                Warned(
                    f"{name}: {', '.join(lost[name])} cannot be expressed in this format; --check"
                    f" RUN refits the model without them"
                )
            )
    refused, bare_rad, lab, replays = (
        _checked(formats, model, models, runs, rig, on_event) if runs else ({}, None, None, {})
    )
    files = {}
    for name in formats:
        if name not in refused:
            error = check_of(replays[name], bare_rad) if bare_rad is not None else None
            files[name] = write_export(FORMATS[name], models[name], rig, out, lost[name], error)
    instead = {name: moving(own_model) for name, own_model in models.items() if own_model is not model}
    with_reasons = {name: reasons for name, reasons in lost.items() if reasons}
    return ExportResult(
        files,
        with_reasons,
        instead,
        refused,
        bare_rad,
        lab,
        replays,
        torque_kinds(runs),
        _scale(model),
        model.scale_sentence,
        has_effects=bool(model.effects),
    )


def _scale(model: "AnyModel") -> dict[str, Any] | None:
    from dpr_lab.identification.moving_arm.model import MovingArmModel

    if isinstance(model, MovingArmModel):
        assumed = model.absolute[model.scale]
        ends = {"interval90": assumed.interval90, "fixed_by": assumed.fixed_by}
        return {"b": assumed.value, **ends, "inertia": model.scale}
    return model.scale.model_dump() if model.scale else None


def model_to_export(file: Path, rig: "Rig") -> "AnyModel":
    """Read a model of a rig from its file or the folder of a diagnosis.

    Raises:
        RunError: the model cannot be read, or belongs to another rig.
    """
    from dpr_lab.identification.moving_arm.model import MovingArmModel, load_model

    model = load_model(file)
    if not isinstance(model, MovingArmModel):
        model.starting_point(rig)
        return model.scaled_ratios()
    if (model.rig.name, model.rig.L1, model.mounted) != (rig.name, rig.L1, rig.rods.mounted):
        raise RunError(f"{file}: is a model of rig {model.rig.name} with other rods or lengths than {rig.name}")
    return model


def model_to_write(file: Path, rig: "Rig", on_event: OnEvent) -> "AnyModel":
    """Read a model as `model_to_export` does, with the friction and the spring of its arm as effects.

    Negative friction and stiffness are set to zero with a warning: the joint would supply energy or be unstable.
    """
    from dpr_lab.identification.moving_arm.model import MovingArmModel

    model = model_to_export(file, rig)
    if not isinstance(model, MovingArmModel):
        return model
    for name in model.negative:
        reason = "a spring cannot push the arm away" if name == "k0" else "it would supply energy"
        on_event(Warned(f"{name}: the estimate is negative; the files contain zero, because {reason}"))
    return model.without_negative().with_arm_effects()


def _checked(
    formats: Sequence[str],
    model: "AnyModel",
    models: "dict[str, AnyModel]",
    runs: Sequence["Run"],
    rig: "Rig",
    on_event: OnEvent,
) -> "tuple[dict[str, str], float, Replayed, dict[str, Replayed]]":
    """Replay the model in each program.

    Returns:
        reason for each refused format, error of the bare model, rad, and the errors of the model in dpr-lab's own
        simulation and in each program
    """
    from dpr_lab.exports import FORMATS
    from dpr_lab.exports.cost import REPLAY_RULE, export_reference
    from dpr_lab.exports.replay import replayed

    stages = len(formats) + 1
    on_event(StageBegan(1, stages, "dpr-lab's own simulation"))
    reference = export_reference(model, runs, rig)
    replays, refused = {}, {}
    for number, name in enumerate(formats, 2):
        on_event(StageBegan(number, stages, FORMATS[name].program))
        models[name], swings = reference.chosen_model(models[name])
        angles = replayed(name, models[name], rig, swings)
        replays[name] = reference.replayed(
            swings, [swing.error(theta) for swing, theta in zip(swings, angles, strict=True)]
        )
        if not replays[name].off_rad <= REPLAY_RULE.worse * reference.bare_rad:
            refused[name] = (
                f"{name} was not written: its error on these runs is {1e3 * replays[name].off_rad:.3g} mrad, but the"
                f" error of the bare model is {1e3 * reference.bare_rad:.3g} mrad; diagnose more recordings, or use"
                " another format"
            )
    return refused, reference.bare_rad, reference.replayed(reference.own), replays


def warn_of_one_rod(model: "AnyModel", rig: "Rig", on_event: OnEvent) -> None:
    """Warn if the files contain only the inner rod of a rig with two rods."""
    from dpr_lab.identification.model import Model

    if isinstance(model, Model) and model.fitted and rig.rods.mounted == "both":
        on_event(
            Warned(
                "the model was identified from the inner rod alone, so the files contain only this rod. For both rods,"
                " identify from recordings of both rods"
            )
        )
