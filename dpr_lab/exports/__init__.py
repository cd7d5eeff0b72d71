"""Export the corrected model to the formats of other programs.

To add a format, write one file and add one row to `FORMATS`. `Effect.exported` describes an effect by elements that
simulators have in common. Programs that can call functions receive the kernel of the effect instead. If a format
supports neither representation, the exported file lacks the effect, and the reason is listed.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from dpr_lab.effects import EFFECTS
from dpr_lab.exports import mjcf, sdf, urdf
from dpr_lab.exports.bodies import in_words, left_out
from dpr_lab.exports.fmu import fmu
from dpr_lab.exports.programs import Program, in_fmu, in_mujoco, in_python, in_sdf, in_urdf
from dpr_lab.exports.python_module import python_module
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.plugins.rows import plugin_rows
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """Export format: its program, its files, and the effects that the files can contain."""

    program: str
    """Name of the program or file format, for messages."""
    main: str
    """Name of the main file."""
    files: Callable[[AnyModel, Rig, Mapping[str, str]], Mapping[str, str | bytes]]
    """Function that returns the contents of the files by name, from model, rig and lost effects."""
    runs_in: Program
    """Program that replays recordings with the written files, to measure the loss of accuracy."""
    words: frozenset[str] = frozenset()
    """Elements of effects that the format supports (`dpr_lab.exports.bodies`)."""
    calls: tuple[str, ...] = ()
    """Stages of the effects whose kernels the program can call."""
    optional: bool = False
    """Whether the format requires optional packages; `diagnose --out` does not write such a format."""

    def lost(self, model: AnyModel, rig: Rig) -> dict[str, str]:
        """Return the effects that the format cannot express, with a reason for each."""
        expressed = set(in_words(model, rig, self.words))
        expressed |= {name for name in model.effects if name in EFFECTS and EFFECTS[name].stage in self.calls}
        return left_out(model, expressed, self.program)

    def written(
        self, model: AnyModel, rig: Rig, lost: Mapping[str, str] | None = None, check: Mapping[str, Any] | None = None
    ) -> dict[str, str | bytes]:
        """Generate the files of the export; the result maps file names to contents.

        If the format cannot express an effect, a JSON file states the reason.

        Args:
            model: the model to write
            rig: the rig of the model
            lost: omitted effects and the reasons; None: the effects of the model that the format cannot express
            check: errors of the export and of the bare model, for the JSON file
        """
        lost = self.lost(model, rig) if lost is None else lost
        document = {"lost": dict(lost), "check": check}
        losses = {f"{self.main}.lost.json": json.dumps(document, ensure_ascii=False, indent=1) + "\n"} if lost else {}
        return dict(self.files(model, rig, lost)) | losses


_ALL = (
    "torque", "load", "arm", "timing", "encoder", "play", "play1", "play0", "torque0", "drive0", "timing0", "encoder0",
    "input", "whole0",
)  # fmt: skip


def _unit(standard: str, file: str) -> ExportFormat:
    """Return the export format of FMUs for a version of the FMI standard."""
    return ExportFormat(
        f"FMI {standard[0]}",
        file,
        lambda model, rig, _: {file: fmu(model, rig, standard)},
        in_fmu,
        calls=_ALL,
        optional=True,
    )


FORMATS: dict[str, ExportFormat] = {
    "python": ExportFormat(
        "Python",
        "corrected_model.py",
        lambda model, rig, _: {"corrected_model.py": python_module(model, rig)},
        in_python,
        calls=_ALL,
    ),
    "mjcf": ExportFormat(
        "MuJoCo",
        mjcf.XML,
        lambda model, rig, _: {mjcf.XML: mjcf.mjcf(model, rig), mjcf.CALLBACK: mjcf.passive(model, rig)},
        in_mujoco,
        mjcf.WORDS,
        # a motor behind backlash would be an additional body
        tuple(stage for stage in _ALL if stage not in ("arm", "play0")),
    ),
    "urdf": ExportFormat(
        "URDF", "corrected_model.urdf", lambda *model: {"corrected_model.urdf": urdf.urdf(*model)}, in_urdf, urdf.WORDS
    ),
    "sdf": ExportFormat(
        "SDFormat", "corrected_model.sdf", lambda *model: {"corrected_model.sdf": sdf.sdf(*model)}, in_sdf, sdf.WORDS
    ),
    "fmu": _unit("3.0", "corrected_model.fmu"),
    "fmu2": _unit("2.0", "corrected_model_fmi2.fmu"),
}
FORMATS |= plugin_rows("exports", ExportFormat, FORMATS)
"""Definition of each export format, by its name."""


def format_words(name: str) -> str:
    """Return the program and the identifier of a format, for example `MuJoCo [mjcf]`."""
    return f"{FORMATS[name].program} [{name}]"
