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
from dpr_lab.planning.result import Plan


class PrintedCause(BaseModel):
    """One number of the user's model that differs from the rig."""

    model_config = ConfigDict(extra="forbid")

    joint: str
    """Name of the joint in the model."""
    quantity: str
    """Name of the quantity in words."""
    before: float
    """Value in the model, SI."""
    after: float
    """Identified value, SI."""
    unit: str
    """Unit of both values."""
    effect: str
    """Named effect that this number represents; empty for damping, centroids and inertias."""
    share: float
    """Increase of the error over segments if this number keeps its value of the model, relative to the increase if
    nothing is corrected.
    """


class PrintedChange(BaseModel):
    """One attribute of the model's file that was changed."""

    model_config = ConfigDict(extra="forbid")

    element: str
    """Name of the element in words."""
    attribute: str
    """Name of the attribute."""
    before: str
    """Old value; empty if the attribute was missing."""
    after: str
    """New value."""


class PrintedReplay(BaseModel):
    """Errors of free runs on one recording with the numbers of both files, root mean square over both rods."""

    model_config = ConfigDict(extra="forbid")

    run: str
    """Name of the recording."""
    until_s: float
    """Predictability horizon, s since the release."""
    before_rad: float
    """Error with the user's file, rad."""
    after_rad: float
    """Error with the changed file, rad."""
    lab_rad: float
    """Error of the corrected model in dpr-lab, rad."""
    passive_rad: float | None = None
    """Error with passive forces and the file that belongs to them, rad; null without such forces."""


class PrintedSimulator(BaseModel):
    """Additional content of `diagnose --simulator`."""

    model_config = ConfigDict(extra="forbid")

    file: str
    """Path of the user's model."""
    format: str
    """`MJCF`, `URDF` or `SDFormat`."""
    joints: list[str]
    """Names of the joints of inner rod and outer rod in the model."""
    causes: list[PrintedCause]
    """Recommended changes, the most important cause first."""
    unnamed: list[str]
    """Named effects that no attribute of a body or joint represents."""
    changes: list[PrintedChange]
    """Changed attributes or texts of the file."""
    diff: str
    """Unified diff of the file."""
    lost: dict[str, str]
    """Effect -> reason why the file cannot contain it."""
    passive: list[str]
    """Those among them that the module of passive forces contains (MuJoCo), together with a file of its own."""
    replays: list[PrintedReplay]
    """Errors on held-out recordings, or on the fitted ones if none are held out; empty without MuJoCo."""
    refused: str
    """Reason why the file cannot be changed; empty if it can."""


class PrintedDiagnosis(Diagnosis):
    """Output of `dpr-lab diagnose --json`, and `diagnosis.json` in the folder of a diagnosis."""

    files: dict[str, str] = Field(default={})
    """Name of each written file -> its path."""
    simulator: PrintedSimulator | None = None
    """With `--simulator`: the causes as numbers of the user's model, and its changes."""


class CheckedDiagnosis(Diagnosis):
    """Output of `dpr-lab check --json`: the diagnosis after a check, which is the last one in `checks_done`."""


class PrintedPlan(Plan):
    """What `dpr-lab plan --json` prints, and `plan.json` of its folder."""

    files: dict[str, str] = Field(default={})
    """Name of each file that was written -> its path."""


class PrintedModel(Model):
    """Output of `dpr-lab identify --json`, and `model.json`."""

    model: str = ""
    """Path of the written file; not in the file itself."""


class PrintedMovingArm(MovingArmModel):
    """The same for a rig with a free or driven arm."""

    model: str = ""
    """Path of the written file; not in the file itself."""


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
    """Output of `dpr-lab drift --json`."""

    drifted: bool
    """Whether any parameter changed significantly."""
    sentence: str
    """The result in words."""
    assumed_b: float | None
    """Assumed b of absolute sizes, kg m^2; null if the runs identify b."""
    runs: tuple[DriftRun, ...]
    """Estimates of each run, in the order of time."""
    torques: tuple[str, ...]
    """Kinds of the known torques that drove the runs."""
    files: dict[str, str]
    """Name of each written file -> its path."""


@dataclass(frozen=True, slots=True)
class PublishedSchema:
    """A type and the version of its schema, which increases when a reader of the previous version would fail."""

    type: Any
    printed_by: str
    """Commands with `--json` that print it."""
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
"""Name of a schema for `dpr-lab schema` -> published type."""
