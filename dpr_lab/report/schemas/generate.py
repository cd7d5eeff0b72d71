"""Generate the JSON Schemas (2020-12) of the results from their types.

A schema contains the fields, their bounds and their descriptions.
"""

import ast
import inspect
import textwrap
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from dpr_lab.errors import ConfigError, unknown_name
from dpr_lab.report.schemas.printed import SCHEMAS


def schema(name: str) -> dict[str, Any]:
    """Generate the JSON Schema of a result.

    Raises:
        ConfigError: there is no schema with this name.
    """
    if name not in SCHEMAS:
        raise ConfigError(unknown_name(f"no schema named {name}", name, SCHEMAS))
    published = SCHEMAS[name]
    body = TypeAdapter(published.type).json_schema(mode="serialization", schema_generator=_WithTexts)
    head = {"$schema": GenerateJsonSchema.schema_dialect, "$id": f"urn:dpr-lab:schema:{name}:{published.version}"}
    return {**head, **body, "title": f"dpr-lab {name}, version {published.version}"}


class _WithTexts(GenerateJsonSchema):
    """Schema generator that adds the docstrings of fields and forbids other keys."""

    def model_schema(self, schema: Any) -> dict[str, Any]:
        return _described(super().model_schema(schema), schema["cls"])

    def dataclass_schema(self, schema: Any) -> dict[str, Any]:
        return _described(super().dataclass_schema(schema), schema["cls"])


def _described(made: dict[str, Any], cls: type) -> dict[str, Any]:
    made.setdefault("additionalProperties", False)
    for name in getattr(cls, "model_computed_fields", ()):  # older files do not contain it
        made["required"].remove(name)
    texts = {name: text for base in reversed(cls.__mro__) for name, text in _texts(base).items()}
    aliases = {name: field.alias or name for name, field in getattr(cls, "model_fields", {}).items()}
    for name, text in texts.items():
        if name in made["properties"] or aliases.get(name) in made["properties"]:
            made["properties"][aliases.get(name, name)].setdefault("description", text)
    return made


def _texts(cls: type) -> dict[str, str]:
    """Return the docstring of each field of a class, as written in the source."""
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
