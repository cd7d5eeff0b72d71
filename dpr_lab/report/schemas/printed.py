"""Types of the results that commands print as JSON."""

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from dpr_lab.acceptance.judge import Acceptance
from dpr_lab.certificate.document import Certificate
from dpr_lab.drift.changes import Drift
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import MovingArmModel


class PrintedCause(BaseModel):
    """One number of the user's model that differs from the rig."""

    model_config = ConfigDict(extra="forbid")

    joint: str
    """Name of the joint in the model."""
    quantity: str
    """What it is, in words."""
    before: float
    """In the model, SI."""
    after: float
    """Identified, SI."""
    unit: str
    """SI."""
    effect: str
    """The named effect that it is; empty for damping, centroids and inertias."""
    share: float
    """Growth of the error over segments where it stays as in the model, over that with nothing corrected."""


class PrintedChange(BaseModel):
    """One attribute of the model's file that was changed."""

    model_config = ConfigDict(extra="forbid")

    element: str
    """The element, in words."""
    attribute: str
    """Its attribute."""
    before: str
    """Empty for an attribute that was not there."""
    after: str
    """What it is now."""


class PrintedSimulator(BaseModel):
    """What `diagnose --simulator` adds."""

    model_config = ConfigDict(extra="forbid")

    file: str
    """The user's model."""
    format: str
    """`MJCF`, `URDF` or `SDFormat`."""
    joints: list[str]
    """Of inner rod and outer rod, as the model names them."""
    causes: list[PrintedCause]
    """What to change, the first cause first."""
    unnamed: list[str]
    """Named effects that no number of a body or joint expresses."""
    changes: list[PrintedChange]
    """Of a MJCF file: the attributes that change."""
    diff: str
    """Of a MJCF file: unified diff."""
    refused: str
    """Why a MJCF file cannot be changed; empty where it can."""


class PrintedDiagnosis(Diagnosis):
    """What `dpr-lab diagnose --json` prints, and `diagnosis.json` of its folder."""

    files: dict[str, str] = Field(default={})
    """Name of each file that was written -> its path."""
    simulator: PrintedSimulator | None = None
    """With `--simulator`: the causes in the words of the user's model, and its changes."""


class CheckedDiagnosis(Diagnosis):
    """What `dpr-lab check --json` prints: the diagnosis after a check, which `checks_done` lists last."""


class PrintedModel(Model):
    """What `dpr-lab identify --json` prints, and `model.json`."""

    model: str = ""
    """Path of the file that was written; not in the file itself."""


class PrintedMovingArm(MovingArmModel):
    """The same of a rig whose arm was free or driven."""

    model: str = ""
    """Path of the file that was written; not in the file itself."""


class DriftRun(BaseModel):
    """Estimates of one run: parameter -> value, SI."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float]  # pyright: ignore[reportIncompatibleVariableOverride]

    name: str
    """Name of the run."""
    group: str
    """Name of its group."""


@dataclass(frozen=True, slots=True)
class PrintedDrift(Drift):
    """What `dpr-lab drift --json` prints."""

    drifted: bool
    """Whether any parameter changed significantly."""
    sentence: str
    """The result in words."""
    assumed_b: float | None
    """b that absolute sizes assume, kg m^2; null where the runs identify it."""
    runs: tuple[DriftRun, ...]
    """Estimates of each run, in the order of time."""
    torques: tuple[str, ...]
    """Kinds of the known torques that drove the runs."""
    files: dict[str, str]
    """Name of each file that was written -> its path."""


@dataclass(frozen=True, slots=True)
class PublishedSchema:
    """A type and the version of its schema, which rises when a reader of the last one would fail."""

    type: Any
    printed_by: str
    """Command with `--json`."""
    version: int = 1


SCHEMAS = {
    "diagnosis": PublishedSchema(PrintedDiagnosis, "diagnose, trials diagnose"),
    "model": PublishedSchema(PrintedModel | PrintedMovingArm, "identify"),
    "check": PublishedSchema(CheckedDiagnosis, "check"),
    "certificate": PublishedSchema(Certificate, "certify"),
    "drift": PublishedSchema(PrintedDrift, "drift"),
    "accept": PublishedSchema(Acceptance, "accept"),
}
"""Name, as `dpr-lab schema` takes it -> what it describes."""
