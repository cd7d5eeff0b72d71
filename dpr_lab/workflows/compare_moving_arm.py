"""Comparison of runs with a model of a rig whose arm is free or driven."""

from typing import TYPE_CHECKING, Any

from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.events import ArmRunCompared, OnEvent, ignore

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dpr_lab.identification.compare import Comparison
    from dpr_lab.identification.model import Model
    from dpr_lab.identification.moving_arm.identify import ArmComparison
    from dpr_lab.identification.moving_arm.model import MovingArmModel
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run
    from dpr_lab.workflows.compare import CompareRequest


def compare_moving_arm(request: "CompareRequest", on_event: OnEvent = ignore) -> dict[str, Any] | None:
    """Compare runs by segment with a model of a moving arm.

    The result is None if the model has no moving arm, or if the request names no folder. `report.html` with its
    figures, and the measured and simulated angles as `comparison.csv`, are written to the folder. Events: `RunRead`,
    `ArmRunCompared`.

    Raises:
        ConfigError: a file with the name of the folder exists.
        RunError: the model or a run cannot be read, or the model belongs to another rig.
    """
    from dpr_lab.errors import RunError
    from dpr_lab.identification.moving_arm.model import load_moving_arm_model

    loaded, out = load_moving_arm_model(request.model), request.out
    if loaded is None or out is None:
        return None
    from dpr_lab.estimation.usable_runs import refuse_repeated
    from dpr_lab.report.pages.moving_arm import write_arm_report
    from dpr_lab.storage.reader import stored_rig
    from dpr_lab.whole_file import write_text
    from dpr_lab.workflows.reading import read_runs

    check_folder_writable(out)
    rigs = [stored_rig(file) for file in request.runs]
    recorded = [
        read_runs([file], rig, on_event, request.any_clock, request.torque)[0]
        for file, rig in zip(request.runs, rigs, strict=True)
    ]
    refuse_repeated(recorded)
    compared: list[ArmComparison] = []
    for run, rig in zip(recorded, rigs, strict=True):
        compared.append(compare_arm_run(run, rig, loaded))
        on_event(ArmRunCompared(compared[-1]))
    out.mkdir(parents=True, exist_ok=True)
    file = out / "comparison.csv"
    write_text(file, angles_csv(compared), RunError)
    keys = ("run", "held_out", "segment_s", "rms_rad", "noise_rad")
    saved = {"file": str(file), "runs": [{key: getattr(comparison, key) for key in keys} for comparison in compared]}
    return saved | {"report": str(write_arm_report(loaded, compared, saved, out))}


def angles_csv(compared: "Sequence[ArmComparison]") -> str:
    """Return the measured and simulated angles as CSV text.

    Joints without an encoder have the value nan. Instants at which no joint was simulated are omitted.
    """
    import numpy as np

    rows = [
        ",".join([comparison.run, *(f"{value:.9g}" for value in (t, *measured, *simulated))])
        for comparison in compared
        for t, measured, simulated in zip(comparison.t, comparison.measured, comparison.simulated, strict=True)
        if np.isfinite(simulated).any()
    ]
    names = [f"{kind}_joint{joint}_rad" for kind in ("measured", "simulated") for joint in range(3)]
    return "\n".join([",".join(["run", "t_s", *names]), *rows]) + "\n"


def compare_any_run(
    run: "Run", rig: "Rig", model: "Model | MovingArmModel", segment_s: float = 0.5
) -> "Comparison | ArmComparison":
    """Simulate a run by segments with a model of any arm.

    Only the initial states are fitted. If the arm is clamped or prescribed, the result also contains one free run, from
    the initial state of the first segment.

    Args:
        run: the measurement
        rig: its rig, whose encoders determine the noise floor
        model: model of `identify` or `corrected_model`
        segment_s: length of a segment, s

    Raises:
        RunError: the run or the model belongs to another rig, the model belongs to another mode of the arm, or the
            model cannot follow the readings.
    """
    from dpr_lab.estimation.usable_runs import refuse_other_rigs
    from dpr_lab.identification.compare import compare_run
    from dpr_lab.identification.moving_arm.model import MovingArmModel

    refuse_other_rigs([run], rig.name)
    if isinstance(model, MovingArmModel):
        return compare_arm_run(run, rig, model, segment_s)
    return compare_run(run, rig, model, segment_s)


def compare_arm_run(run: "Run", rig: "Rig", model: "MovingArmModel", segment_s: float = 0.5) -> "ArmComparison":
    """Simulate a run by segment with a model of a moving arm.

    See `compare_any_run` for arguments and errors.
    """
    if model.effects:
        return _with_effects(run, rig, model, segment_s)
    from dpr_lab.identification.moving_arm.identify import compare_moving_arm as compare_bare

    return compare_bare(run, rig, model, segment_s)


def _with_effects(run: "Run", rig: "Rig", model: "MovingArmModel", segment_s: float) -> "ArmComparison":
    """Simulate a run by segments with a corrected model and its effects.

    Only the initial states are fitted.

    Raises:
        RunError: the model belongs to another rig, or cannot follow the readings.
    """
    import numpy as np

    from dpr_lab.exports.moving_arm.replay import follow_with_arm
    from dpr_lab.identification.moving_arm.identify import JOINTS_READ, ArmComparison

    followed = follow_with_arm(run, rig, model, segment_s)
    away = followed.measured - followed.simulated
    read = [k for k in range(len(JOINTS_READ)) if np.isfinite(followed.noise[k])]
    return ArmComparison(
        followed.run,
        not model.used(run.sha256),
        followed.t,
        followed.measured,
        followed.simulated,
        segment_s,
        {JOINTS_READ[k]: float(np.sqrt(np.nanmean(away[:, k] ** 2))) for k in read},
        {JOINTS_READ[k]: float(followed.noise[k]) for k in read},
    )
