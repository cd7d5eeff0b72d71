"""Write the corrected model into a copy of the user's simulator model."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.workflows.checks import refuse_own_folder
from dpr_lab.workflows.events import OnEvent, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.exports.into.replay import FileReplay
    from dpr_lab.simulator_models.xml_edit import ChangedAttribute


@dataclass(frozen=True, slots=True)
class ExportedInto:
    """Changed copy of the user's model, with the list of changes."""

    file: Path
    diff_file: Path
    diff: str
    """Unified diff of the original and the changed file."""
    changes: "tuple[ChangedAttribute, ...]"
    lost: dict[str, str]
    """Reason for each effect that neither the file nor the module of passive forces can contain."""
    passive: tuple[str, ...] = ()
    """Effects that only the module of passive forces contains."""
    passive_file: Path | None = None
    """File of the module of passive forces, for MuJoCo; None if there are no such effects."""
    replays: "tuple[FileReplay, ...]" = ()
    """Replay errors before and after the change, on the recordings to check."""

    def to_json(self) -> dict[str, Any]:
        """Return the output of `dpr-lab export --into --json`."""
        return {"schema": 1, **asdict(self)}


def export_into(
    model: Path,
    rig: str,
    into: Path,
    out: Path,
    joints: Sequence[str] = (),
    check: Sequence[Path] = (),
    torque: str | None = None,
    on_event: OnEvent = ignore,
) -> ExportedInto:
    """Write a corrected copy of a simulator file; the original is not changed.

    Args:
        model: model written by `identify` or `diagnose`, or the folder of a diagnosis
        rig: the rig file written by `dpr-lab rig from` for this file
        into: the MJCF, URDF or SDFormat file
        out: folder of the copy and of its diff
        joints: joints of inner rod, outer rod and optionally the arm; empty: detected
        check: runs that are replayed with the numbers of both files
        torque: `measured` or `commanded`: torques to use for runs that contain both; None: measured
        on_event: receives `RunRead` and `Warned`

    Raises:
        ConfigError: the rig, the file or the folder cannot be used.
        RunError: the model or a run cannot be used.
        DprError: a file cannot be written.
    """
    from dpr_lab.exports.into import into_file
    from dpr_lab.exports.into.replay import replay_files
    from dpr_lab.identification.moving_arm.model import MovingArmModel
    from dpr_lab.rig import load_rig
    from dpr_lab.whole_file import write_text
    from dpr_lab.workflows.export import model_to_write

    refuse_own_folder(out, into)
    loaded_rig = load_rig(rig)
    loaded = model_to_write(model, loaded_rig, on_event)
    patched = into_file(loaded, loaded_rig, into, joints)
    file, module = patched.write(out, into.name)
    diff_file, diff = out / f"{into.name}.diff", patched.diff(into, str(file))
    write_text(diff_file, diff)
    runs = read_runs(check, loaded_rig, on_event, torque=torque, moving=isinstance(loaded, MovingArmModel))
    replays = replay_files(into, patched, joints, loaded, loaded_rig, runs) if runs else []
    effects = patched.passive.effects
    return ExportedInto(file, diff_file, diff, patched.changes, patched.lost, effects, module, tuple(replays))
