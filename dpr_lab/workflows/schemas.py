"""JSON Schemas (2020-12) of the results, generated from their types: the same fields, bounds and texts."""

import ast
import inspect
import textwrap
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from dpr_lab.certificate.document import Certificate
from dpr_lab.drift.changes import Drift
from dpr_lab.errors import ConfigError, unknown_name
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import MovingArmModel


class PrintedDiagnosis(Diagnosis):
    """What `dpr-lab diagnose --json` prints, and `diagnosis.json` of its folder."""

    files: dict[str, str] = Field(default={})
    """Name of each file that was written -> its path."""


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
}
"""Name, as `dpr-lab schema` takes it -> what it describes."""


def schema(name: str) -> dict[str, Any]:
    """The JSON Schema of a result.

    Raises:
        ConfigError: no such schema.
    """
    if name not in SCHEMAS:
        raise ConfigError(unknown_name(f"no schema named {name}", name, SCHEMAS))
    published = SCHEMAS[name]
    body = TypeAdapter(published.type).json_schema(mode="serialization", schema_generator=_WithTexts)
    head = {"$schema": GenerateJsonSchema.schema_dialect, "$id": f"urn:dpr-lab:schema:{name}:{published.version}"}
    return {**head, **body, "title": f"dpr-lab {name}, version {published.version}"}


class _WithTexts(GenerateJsonSchema):
    """Properties are described by the strings below the fields; keys that no field names are refused."""

    def model_schema(self, schema: Any) -> dict[str, Any]:
        return _described(super().model_schema(schema), schema["cls"])

    def dataclass_schema(self, schema: Any) -> dict[str, Any]:
        return _described(super().dataclass_schema(schema), schema["cls"])


def _described(made: dict[str, Any], cls: type) -> dict[str, Any]:
    made.setdefault("additionalProperties", False)
    texts = {name: text for base in reversed(cls.__mro__) for name, text in _texts(base).items()}
    aliases = {name: field.alias or name for name, field in getattr(cls, "model_fields", {}).items()}
    for name, text in texts.items():
        if name in made["properties"] or aliases.get(name) in made["properties"]:
            made["properties"][aliases.get(name, name)].setdefault("description", text)
    return made


def _texts(cls: type) -> dict[str, str]:
    """Field -> the string below it in the source."""
    if not cls.__module__.startswith("dpr_lab."):
        return {}
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    assert isinstance(body, ast.ClassDef)
    texts = {}
    for field, below in zip(body.body, body.body[1:], strict=False):
        match field, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                texts[name] = inspect.cleandoc(text)
    return texts
