"""Diagnosis relative to the user's simulator model, and the corrected copy of this model."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError
from dpr_lab.gap.result import RECORD
from dpr_lab.workflows.checks import refuse_own_folder
from dpr_lab.workflows.diagnose import DiagnoseRequest, DiagnoseResult, diagnose
from dpr_lab.workflows.events import OnEvent, ignore

if TYPE_CHECKING:
    from dpr_lab.exports.into.least_change import LeastChange
    from dpr_lab.exports.into.replay import FileReplay
    from dpr_lab.exports.into.target import PatchedModel
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.identification.moving_arm.model import AnyModel
    from dpr_lab.report.schemas.printed import PrintedSimulator
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run
    from dpr_lab.simulator_models.chain import ModelChain
    from dpr_lab.simulator_models.tree import SimulatorModel


FORCED = "with_passive_forces"
"""Subfolder of the diagnosis for the model file that is used with a module of passive forces."""


@dataclass(frozen=True, slots=True)
class SimulatorDiagnosis:
    """Diagnosis relative to the user's model, and the changes that the model needs."""

    result: DiagnoseResult
    simulator: "PrintedSimulator"

    def to_json(self) -> dict[str, Any]:
        """Return the JSON values of `diagnose` with the additional key `simulator`.

        The command `diagnose --simulator --json` prints them.
        """
        return self.result.to_json() | {"simulator": self.simulator.model_dump()}


def diagnose_simulator(
    request: DiagnoseRequest, simulator: Path, joints: Sequence[str] = (), on_event: OnEvent = ignore
) -> SimulatorDiagnosis:
    """Explain the gap between a simulator model and the rig, and write a corrected copy of the model.

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
    from dpr_lab.report.schemas.printed import PrintedSimulator
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
    try:
        least = _least_change(result.diagnosis, written, rig, chain, runs)
    except ConfigError as error:
        raise ConfigError(f"{simulator}: {error}") from error
    names = [part.joint.name for part in chain.parts]
    printed = PrintedSimulator(
        file=str(simulator),
        format=read.format,
        joints=names,
        causes=list(least.causes),
        unnamed=list(least.unnamed),
        changes=[],
        diff="",
        lost=left_out(model, unchanged(model, written), read.format),
        passive=[],
        replays=[],
        refused="",
    )
    files = dict(result.files)
    try:
        patched = into_file(least.model, rig, simulator, joints)
    except ConfigError as error:  # the diagnosis is still valid
        printed.refused = str(error)
    else:
        forced = _forced(model, rig, simulator, joints) if printed.lost else None
        printed.changes, printed.lost = list(patched.changes), printed.lost | patched.lost
        printed.diff = patched.diff(simulator, f"corrected {simulator.name}")
        printed.passive = list(forced.passive.effects) if forced else []
        if find_spec("mujoco"):
            unseen = read_runs(request.held_out, rig, ignore, request.any_clock, request.torque, moving=moving)
            printed.replays = _replays(simulator, patched, forced, names, model, rig, unseen or runs)
        if request.out:
            files |= _written(patched, forced, printed.diff, request.out, simulator.name)
    done = SimulatorDiagnosis(replace(result, files=files), printed)
    if request.out:
        write_json(done.to_json(), request.out / RECORD)
    return done


def _written(patched: "PatchedModel", forced: "PatchedModel | None", diff: str, out: Path, name: str) -> dict[str, str]:
    """Write the changed copies of the user's model and the difference; return the paths by name."""
    from dpr_lab.whole_file import write_text

    write_text(out / f"{name}.diff", diff)
    file, _ = patched.write(out, name)
    files = {"simulator model": str(file), "difference": str(out / f"{name}.diff")}
    if forced:
        file, module = forced.write(out / FORCED, name)
        files |= {"model for passive forces": str(file), "passive forces": str(module)}
    return files


def _chain(simulator: Path, read: "SimulatorModel", joints: Sequence[str], rig: "Rig") -> "ModelChain":
    """Find the rods in the user's model.

    Raises:
        ConfigError: the model contains no such rods, or belongs to another rig.
    """
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
    names: Sequence[str],
    model: "AnyModel",
    rig: "Rig",
    runs: "Sequence[Run]",
) -> "list[FileReplay]":
    """Return the replay errors of the original and the changed files for each recording."""
    from dpr_lab.exports.into.replay import replay_files

    replays = replay_files(simulator, patched, names, model, rig, runs)
    if forced and replays:
        others = replay_files(simulator, forced, names, model, rig, runs)
        replays = [replace(a, passive_rad=b.passive_rad) for a, b in zip(replays, others, strict=True)]
    return replays


def _forced(model: "AnyModel", rig: "Rig", simulator: Path, joints: Sequence[str]) -> "PatchedModel | None":
    """Return the changed file for use with a module of passive forces.

    The module contains the effects for which the format has no element. The result is None if there are no such
    effects, or if the file cannot be changed.
    """
    from dpr_lab.exports.into import into_file

    try:
        whole = into_file(model, rig, simulator, joints)
    except ConfigError:  # only this file cannot be written; the file of the simpler model exists
        return None
    return whole if whole.passive.module else None
