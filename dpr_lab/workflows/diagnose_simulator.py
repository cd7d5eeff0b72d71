"""Diagnosis relative to the user's simulator model, and the corrected copy of this model."""

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError
from dpr_lab.gap.result import RECORD
from dpr_lab.workflows.checks import refuse_own_folder
from dpr_lab.workflows.diagnose import DiagnoseRequest, DiagnoseResult, diagnose
from dpr_lab.workflows.events import OnEvent, ignore

if TYPE_CHECKING:
    from dpr_lab.exports.bodies import AnyModel
    from dpr_lab.exports.into.least_change import LeastChange
    from dpr_lab.exports.into.replay import FileReplay
    from dpr_lab.exports.into.target import PatchedModel
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run
    from dpr_lab.simulator_models.chain import ModelChain
    from dpr_lab.simulator_models.tree import SimulatorModel
    from dpr_lab.simulator_models.xml_edit import ChangedAttribute


FORCED = "with_passive_forces"
"""Subfolder of the diagnosis for the model file that is used with a module of passive forces."""


@dataclass(frozen=True, slots=True)
class SimulatorDiagnosis:
    """Diagnosis relative to the user's model, with its changes and the written files."""

    result: DiagnoseResult
    simulator: Path
    format: str
    joints: tuple[str, ...]
    least: "LeastChange"
    changes: "tuple[ChangedAttribute, ...]" = ()
    diff: str = ""
    """Unified diff."""
    lost: dict[str, str] = field(default_factory=dict)
    """Reason for each effect that the file cannot contain."""
    forced: "PatchedModel | None" = None
    """The changed file for use with a module of passive forces, which adds effects that the file cannot contain. None
    if there are no such effects, or if the module cannot contain them either."""
    replays: "tuple[FileReplay, ...]" = ()
    """Replay errors before and after the change, on held-out runs, or on the fitted runs if none are held out."""
    refused: str = ""
    """Reason why the file cannot be changed; empty if it can."""

    def to_json(self) -> dict[str, Any]:
        """Return the JSON values of `diagnose` with the additional key `simulator`.

        The command `diagnose --simulator --json` prints them.
        """
        return self.result.to_json() | {
            "simulator": {
                "file": self.simulator,
                "format": self.format,
                "joints": list(self.joints),
                "causes": [asdict(cause) for cause in self.least.causes],
                "unnamed": list(self.least.unnamed),
                "changes": [asdict(change) for change in self.changes],
                "diff": self.diff,
                "lost": self.lost,
                "passive": list(self.forced.passive.effects) if self.forced else [],
                "replays": [asdict(replay) for replay in self.replays],
                "refused": self.refused,
            }
        }


def diagnose_simulator(
    request: DiagnoseRequest, simulator: Path, joints: Sequence[str] = (), on_event: OnEvent = ignore
) -> SimulatorDiagnosis:
    """Explain the gap between a simulator model and the rig.

    A copy of the model is corrected.

    Args:
        request: as for `diagnose`; with an empty `rig`, `rig_from_model` writes the rig file from the model
        simulator: MJCF, URDF or SDFormat file; it is not changed
        joints: joints of the rods and of an arm in the model, as for `double_pendulum`; empty: detected
        on_event: as for `diagnose`

    Raises:
        ConfigError: the model cannot be read, or does not belong to the rig; and as for `diagnose`.
        RunError: as for `diagnose`.
        IdentificationError: as for `diagnose`.
        DprError: a result cannot be written.
    """
    from dpr_lab.exports.bodies import left_out
    from dpr_lab.exports.corrected import corrected_model
    from dpr_lab.exports.into import WORDS, into_file
    from dpr_lab.exports.into.target import arm_to_change
    from dpr_lab.exports.refit import fitted_in_words, unchanged
    from dpr_lab.report.plain import write_json
    from dpr_lab.rig import load_rig
    from dpr_lab.simulator_models import read_model
    from dpr_lab.workflows.reading import read_runs
    from dpr_lab.workflows.rig_from import rig_from_model

    if request.out:
        refuse_own_folder(request.out, simulator)
    read = read_model(simulator)
    with tempfile.TemporaryDirectory() as folder:
        file = request.rig or str(rig_from_model(simulator, Path(folder) / "rig.toml", joints).file)
        rig = load_rig(file)
        chain = _chain(simulator, read, joints, rig)
        moving = chain.arm is not None
        runs = read_runs(request.runs, rig, ignore, request.any_clock, request.torque, moving=moving)
        result = diagnose(replace(request, rig=file), on_event)
    model = corrected_model(result.diagnosis, runs, rig)
    arm_to_change(model, chain, rig, simulator)
    written = fitted_in_words(model, WORDS[read.format], runs, rig)
    least = _least_change(result.diagnosis, written, rig, chain, runs)
    lost = left_out(model, unchanged(model, written), read.format)
    names = tuple(part.joint.name for part in chain.parts)
    done = SimulatorDiagnosis(result, simulator, read.format, names, least, lost=lost)
    try:
        patched = into_file(least.model, rig, simulator, joints)
    except ConfigError as error:  # the diagnosis is still valid
        done = replace(done, refused=str(error))
        if request.out:
            write_json(done.to_json(), request.out / RECORD)
        return done
    unseen = read_runs(request.held_out, rig, ignore, request.any_clock, request.torque, moving=moving) or runs
    forced = _forced(model, rig, simulator, joints) if lost else None
    done = replace(
        done,
        changes=patched.changes,
        diff=patched.diff(simulator, f"corrected {simulator.name}"),
        lost=lost | patched.lost,
        forced=forced,
        replays=_replays(simulator, patched, forced, names, model, rig, unseen) if find_spec("mujoco") else (),
    )
    return _written(done, request.out, patched.text) if request.out else done


def _chain(simulator: Path, read: "SimulatorModel", joints: Sequence[str], rig: "Rig") -> "ModelChain":
    """Read the rods of the user's model, and compare them with the rig."""
    from dpr_lab.exports.into.target import refuse_other_rig
    from dpr_lab.simulator_models.double_pendulum import double_pendulum

    try:
        chain = double_pendulum(read, joints, rig.g if read.gravity is None else None)
    except ConfigError as error:
        raise ConfigError(f"{simulator}: {error}") from error
    refuse_other_rig(chain, rig.L1, rig.g, simulator)
    return chain


def _least_change(
    diagnosis: "Diagnosis", model: "AnyModel", rig: "Rig", chain: "ModelChain", runs: "Sequence[Run]"
) -> "LeastChange":
    from dpr_lab.exports.into.least_change import least_change
    from dpr_lab.exports.into.least_change_of_arm import least_change_of_arm
    from dpr_lab.identification.moving_arm.model import MovingArmModel

    if isinstance(model, MovingArmModel):
        return least_change_of_arm(diagnosis, model, rig, chain, runs)
    return least_change(diagnosis, model, rig, chain, runs)


def _replays(
    simulator: Path,
    patched: "PatchedModel",
    forced: "PatchedModel | None",
    names: tuple[str, ...],
    model: "AnyModel",
    rig: "Rig",
    runs: "Sequence[Run]",
) -> "tuple[FileReplay, ...]":
    """Return the replay errors of the original and the changed file.

    If there is a file with passive forces, its errors are included.
    """
    from dpr_lab.exports.into.replay import replay_files

    replays = replay_files(simulator, patched, names, model, rig, runs)
    if forced and replays:
        others = replay_files(simulator, forced, names, model, rig, runs)
        replays = [replace(a, passive_rad=b.passive_rad) for a, b in zip(replays, others, strict=True)]
    return tuple(replays)


def _forced(model: "AnyModel", rig: "Rig", simulator: Path, joints: Sequence[str]) -> "PatchedModel | None":
    """Change the file to the complete model if this needs a module of passive forces.

    Otherwise return None.
    """
    from dpr_lab.exports.into import into_file

    try:
        whole = into_file(model, rig, simulator, joints)
    except ConfigError:  # only this file cannot be written; the file of the simpler model exists
        return None
    return whole if whole.passive.module else None


def _written(done: SimulatorDiagnosis, out: Path, text: bytes) -> SimulatorDiagnosis:
    from dpr_lab.exports.mjcf import CALLBACK
    from dpr_lab.report.plain import write_json
    from dpr_lab.whole_file import write_text

    file, diff = out / done.simulator.name, out / f"{done.simulator.name}.diff"
    write_text(file, text.decode("utf-8"))
    write_text(diff, done.diff)
    files = {**done.result.files, "simulator model": str(file), "difference": str(diff)}
    if done.forced:
        folder = out / FORCED
        write_text(folder / done.simulator.name, done.forced.text.decode("utf-8"))
        write_text(folder / CALLBACK, done.forced.passive.module)
        files |= {
            "model for passive forces": str(folder / done.simulator.name),
            "passive forces": str(folder / CALLBACK),
        }
    done = replace(done, result=replace(done.result, files=files))
    write_json(done.to_json(), out / RECORD)
    return done
