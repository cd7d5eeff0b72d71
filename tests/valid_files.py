"""Validate every result that dpr-lab writes as JSON against its published schema, in any test that imports this module.

What tests themselves write, such as damaged files, is not validated.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dpr_lab import whole_file
from tests.schemas import validator

MARKS = {
    "verdict": "diagnosis",
    "claims": "certificate",
    "forecast": "plan",
    "drifted": "drift",
    "would_decide": "accept",
    "ratios": "model",
}
"""Schema of each kind of result, by a key that only this kind contains.

A diagnosis also contains ratios, so it is first.
"""


def schema_of(document: Any) -> str | None:
    """Name of the schema of a document; None if it has no schema."""
    if not isinstance(document, dict) or "score" in document:  # an opened trial
        return None
    return next((name for key, name in MARKS.items() if key in document), None)


def validate_text(text: str) -> None:
    """Validate a document.

    Raises:
        jsonschema.ValidationError: it is not as its schema says.
    """
    document = json.loads(text)
    if name := schema_of(document):
        validator(name).validate(document)


_write_whole = whole_file.write_whole


def write_whole(path: Path, write: Callable[[Path], object], *options: Any) -> None:
    """Write a file like `dpr_lab.whole_file.write_whole`, and validate it."""
    _write_whole(path, write, *options)
    if path.suffix == ".json":
        validate_text(path.read_text(encoding="utf-8"))


whole_file.write_whole = write_whole
