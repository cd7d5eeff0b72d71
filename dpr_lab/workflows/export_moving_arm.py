"""Export of a model with a free or driven arm to other programs, with a replay in each."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError, RunError, unknown_name
from dpr_lab.workflows.checks import refuse_file
from dpr_lab.workflows.events import OnEvent, StageBegan, ignore

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dpr_lab.identification.moving_arm.model import MovingArmModel
    from dpr_lab.rig import Rig
    from dpr_lab.workflows.export import ExportRequest


@dataclass(frozen=True, slots=True)
class ArmReplaySettings:
    """Replay of recordings in other programs."""

    segment_s: float = 1.0
    """Duration of a segment, which starts from its own fitted state."""
    segments: int = 10
    """Maximum number of segments of each run."""
    worse: float = 1.02
    """Largest error in a program over that of dpr-lab's own simulation."""


REPLAY = ArmReplaySettings()


@dataclass(frozen=True, slots=True)
class ArmExportResult:
    """Written files and the error of the exported model in each program."""

    files: dict[str, str]
    """Format -> file."""
    refused: dict[str, str]
    """Format -> reason why it was not written."""
    own_rad: float | None = None
    """Rms error of dpr-lab's own simulation of the replayed runs, rad; None without `--check`."""
    error_rad: dict[str, float] = field(default_factory=dict)
    """Format -> the same in its program."""
    away_rad: dict[str, float] = field(default_factory=dict)
    """Format -> largest difference from dpr-lab's own simulation, rad."""
    scale_sentence: str = ""
    """What the scale of masses, inertias and torques rests on."""

    def to_json(self) -> dict[str, Any]:
        """Output of `dpr-lab export --json`."""
        return {"schema": 1, **asdict(self)}


@dataclass(frozen=True, slots=True)
class _Swing:
    """A segment of a recording, and dpr-lab's simulation of it."""

    t: "NDArray[np.float64]"
    x0: "NDArray[np.float64]"
    inputs: "NDArray[np.float64]"
    measured: "NDArray[np.float64]"
    """(n, 3) angles, rad; zero for a rod that is not mounted."""
    simulated: "NDArray[np.float64]"


def export_moving_arm(request: "ExportRequest", on_event: OnEvent = ignore) -> ArmExportResult | None:
    """Export a model of a rig with a free or driven arm; None where the model is of another kind.

    Errors and events as of `dpr_lab.workflows.export.export`.
    """
    from dpr_lab.exports.moving_arm.formats import ARM_FORMATS
    from dpr_lab.identification.moving_arm.model import load_moving_arm_model
    from dpr_lab.rig import load_rig
    from dpr_lab.whole_file import write_whole

    file = request.model / "model.json" if request.model.is_dir() else request.model
    model = load_moving_arm_model(file)
    if model is None:
        return None
    if unknown := [name for name in request.formats if name not in ARM_FORMATS]:
        raise ConfigError(unknown_name(f"no format named {unknown[0]}", unknown[0], ARM_FORMATS))
    refuse_file(request.out)
    rig = load_rig(request.rig)
    if (model.rig.name, model.rig.L1, model.mounted) != (rig.name, rig.L1, rig.rods.mounted):
        raise RunError(f"{file}: is a model of rig {model.rig.name} with other rods or lengths than {rig.name}")
    swings = _swings(request.check, model, rig)
    files, refused, errors, away = {}, dict[str, str](), {}, {}
    own = _rms([one.measured - one.simulated for one in swings]) if swings else None
    for number, name in enumerate(request.formats, 1):
        chosen = ARM_FORMATS[name]
        on_event(StageBegan(number, len(request.formats), chosen.program))
        content = chosen.content(model, rig)
        data = content if isinstance(content, bytes) else content.encode("utf-8")
        if own is not None:
            errors[name], away[name] = _replayed(name, data, model, rig, swings)
            if not errors[name] <= REPLAY.worse * own:
                refused[name] = (
                    f"{name} was not written: there the model is off by {1e3 * errors[name]:.3g} mrad on these runs,"
                    f" and by {1e3 * own:.3g} mrad in dpr-lab's own simulation"
                )
                continue
        write_whole(request.out / chosen.main, partial(Path.write_bytes, data=data))
        files[name] = str(request.out / chosen.main)
    return ArmExportResult(files, refused, own, errors, away, model.scale_sentence)


def _rms(parts: "Sequence[NDArray[np.float64]]") -> float:
    import numpy as np

    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _replayed(
    name: str, data: bytes, model: "MovingArmModel", rig: "Rig", swings: "Sequence[_Swing]"
) -> tuple[float, float]:
    """Rms error in a program, and largest difference from dpr-lab's own simulation, rad."""
    import tempfile

    import numpy as np

    from dpr_lab.exports.moving_arm.formats import ARM_FORMATS

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / ARM_FORMATS[name].main
        file.write_bytes(data)
        replay = ARM_FORMATS[name].replay(file, model, rig)
        replayed = [replay(one.x0, one.t, one.inputs) for one in swings]
    error = _rms([one.measured - theta for one, theta in zip(swings, replayed, strict=True)])
    away = max(float(np.abs(one.simulated - theta).max()) for one, theta in zip(swings, replayed, strict=True))
    return error, away


def _swings(runs: Sequence[Path], model: "MovingArmModel", rig: "Rig") -> list[_Swing]:
    """Segments of recordings, each with a fitted initial state."""
    import numpy as np

    from dpr_lab.identification.moving_arm.fit import fit_segments
    from dpr_lab.identification.moving_arm.problem import arm_problem, recordings_of
    from dpr_lab.storage.reader import load_run

    swings = []
    for file in runs:
        recordings = recordings_of([load_run(file, rig)], rig)
        (recording,) = recordings
        if recording.run.arm_mode == "clamped":
            raise RunError(f"{file}: its arm is clamped: replay a run whose arm moves")
        problem, initial = arm_problem(recordings, rig, REPLAY.segment_s)
        p = np.array(model.swing)
        fit = fit_segments(problem, p, initial, states_only=True)
        read = problem.weight[0] > 0
        simulated = problem.predict(p, fit.initial)
        if problem.relative:
            simulated[:, 2] += simulated[:, 1]
        for part, x0 in list(zip(problem.slices(), fit.initial, strict=True))[: REPLAY.segments]:
            swings.append(
                _Swing(
                    recording.run.t[part],
                    x0,
                    recording.drive[part],
                    np.where(read, recording.run.theta[part], 0.0),
                    np.where(read, simulated[part], 0.0),
                )
            )
    return swings
