"""JSON Schemas of the results: the published files are generated from the types, and written results are valid."""

import copy
import json
import math
import runpy
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator, ValidationError
from pydantic import BaseModel

from dpr_lab.errors import ConfigError
from dpr_lab.gap.result.saved import Saved
from dpr_lab.identification.scaling.scale import ModelPart
from dpr_lab.report.schemas import SCHEMAS, schema
from dpr_lab.rig_tables import RigTable
from dpr_lab.search.settings import SearchSettings
from tests.schemas import FOLDER, validator

ROOT = Path(__file__).parents[2]
WRITTEN = {
    "diagnosis": ROOT / "tests/tui/data/diagnosis.json",
    "model": ROOT / "tests/tui/data/model.json",
    "certificate": ROOT / "docs/examples/multiarm/certificate.json",
}


@pytest.mark.slow
def test_schemas_in_the_docs_agree_with_the_types() -> None:
    generated = runpy.run_path(str(ROOT / "docs/schemas.py"))["files"]()
    stored = {file.name: file.read_text(encoding="utf-8") for file in FOLDER.iterdir()}
    assert stored == generated, "run python docs/schemas.py; raise the version where a reader would fail"


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_schema_is_valid_itself(name: str) -> None:
    Draft202012Validator.check_schema(dict(validator(name).schema))


@pytest.mark.parametrize("base", [Saved, ModelPart, RigTable, SearchSettings])
def test_records_contain_finite_numbers_only(base: type[BaseModel]) -> None:
    class Record(base):  # pyright: ignore[reportGeneralTypeIssues, reportUntypedBaseClass]
        value: dict[str, tuple[float, ...]]

    for number in (math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match="finite"):
            Record.model_validate({"value": {"one": (0.0, number)}})


@pytest.mark.parametrize("name", WRITTEN)
def test_a_written_file_is_valid_and_a_changed_one_is_not(name: str) -> None:
    document = json.loads(WRITTEN[name].read_text(encoding="utf-8"))
    validator(name).validate(document)
    for change in (_with_key, _without_key, _with_text):
        with pytest.raises(ValidationError):
            validator(name).validate(change(document))


def _with_key(document: dict[str, Any]) -> dict[str, Any]:
    return document | {"misspelt": 1}


def _without_key(document: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in document.items() if key not in ("gap", "fit", "recordings")}


def _with_text(document: dict[str, Any]) -> dict[str, Any]:
    """Replace the first number or object inside a table by a text."""
    changed = copy.deepcopy(document)
    table = changed.get("ratios") or changed["choices"]
    table[next(iter(table))] = "a text"
    return changed


@pytest.mark.parametrize("name", ["diagnosis", "check", "drift"])
def test_every_key_of_a_result_is_documented(name: str) -> None:
    made = schema(name)
    assert [key for key, value in made["properties"].items() if not value.get("description")] == []
    assert made["$id"] == f"urn:dpr-lab:schema:{name}:{SCHEMAS[name].version}"


def test_no_such_schema() -> None:
    with pytest.raises(ConfigError, match="no schema named diagnoses"):
        schema("diagnoses")
