"""Define the types of the results that commands print as JSON."""

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from dpr_lab.acceptance.judge import Acceptance
from dpr_lab.certificate.document import Certificate
from dpr_lab.drift.changes import Drift
from dpr_lab.exports.into.least_change import ModelCause
from dpr_lab.exports.into.replay import FileReplay
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.planning.result import Plan
from dpr_lab.simulator_models.xml_edit import ChangedAttribute


class PrintedSimulator(BaseModel):
    """Additional content of the output of `diagnose --simulator`."""

    model_config = ConfigDict(extra="forbid")

    file: str
    """Path of the user's model."""
    format: str
    """`MJCF`, `URDF` or `SDFormat`."""
    joints: list[str]
    """Names of the joints of inner and outer rod in the model."""
    causes: list[ModelCause]
    """Recommended changes, the most important cause first."""
    unnamed: list[str]
    """Named effects that no attribute of a body or joint can represent."""
    changes: list[ChangedAttribute]
    """Changed attributes or texts of the file."""
    diff: str
    """Unified diff of the file."""
    lost: dict[str, str]
    """Effects that the file cannot contain, each with the reason."""
    passive: list[str]
    """Effects that the file cannot contain, but that a module of passive forces for MuJoCo contains. The module belongs
    to a separate copy of the file."""
    replays: list[FileReplay]
    """Errors on held-out recordings, or on the fitted recordings if none are held out; empty if MuJoCo is missing."""
    refused: str
    """Reason why the file cannot be changed; empty if it can."""


class PrintedDiagnosis(Diagnosis):
    """Output of `dpr-lab diagnose --json`; the file `diagnosis.json` of a diagnosis has the same structure."""

    files: dict[str, str] = Field(default={})
    """Name of each written file -> its path."""
    simulator: PrintedSimulator | None = None
    """With `--simulator`: recommended changes of the user's model."""


class CheckedDiagnosis(Diagnosis):
    """Output of `dpr-lab check --json`: the diagnosis after a check.

    The check is the last entry of `checks_done`.
    """


class PrintedPlan(Plan):
    """Output of `dpr-lab plan --json`; the file `plan.json` of a plan has the same structure."""

    files: dict[str, str] = Field(default={})
    """Name of each written file -> its path."""


class PrintedModel(Model):
    """Output of `dpr-lab identify --json`; the file `model.json` has the same structure."""

    model: str = ""
    """Path of the model file; empty in the file itself."""


class PrintedMovingArm(MovingArmModel):
    """Output of `identify --json` for a rig with a free or driven arm."""

    model: str = ""
    """Path of the model file; empty in the file itself."""


class DriftRun(BaseModel):
    """Estimates of one run, SI units, by parameter."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float]  # pyright: ignore[reportIncompatibleVariableOverride]

    name: str
    """Name of the run."""
    group: str
    """Name of the group that contains the run."""


@dataclass(frozen=True, slots=True)
class PrintedDrift(Drift):
    """Output of `dpr-lab drift --json`."""

    drifted: bool
    """Whether any parameter changed significantly."""
    sentence: str
    """Sentence with the result."""
    assumed_b: float | None
    """Value of b that absolute sizes assume, kg m^2; null if the runs identify b."""
    runs: tuple[DriftRun, ...]
    """Runs with their estimates, in chronological order."""
    torques: tuple[str, ...]
    """Kinds of the known torques that drove the runs."""
    files: dict[str, str]
    """Name of each written file -> its path."""


@dataclass(frozen=True, slots=True)
class PublishedSchema:
    """A published type and the version of its schema.

    The version increases when a reader of the previous version would fail.
    """

    type: Any
    printed_by: str
    """Commands that print the type with `--json`."""
    version: int = 1


SCHEMAS = {
    "diagnosis": PublishedSchema(PrintedDiagnosis, "diagnose, trials diagnose"),
    "model": PublishedSchema(PrintedModel | PrintedMovingArm, "identify"),
    "check": PublishedSchema(CheckedDiagnosis, "check"),
    "certificate": PublishedSchema(Certificate, "certify"),
    "drift": PublishedSchema(PrintedDrift, "drift"),
    "accept": PublishedSchema(Acceptance, "accept"),
    "plan": PublishedSchema(PrintedPlan, "plan"),
}
"""Published type for each name of a schema in `dpr-lab schema`."""
