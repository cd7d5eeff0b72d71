"""Every field of a public result or option is documented by a string below it."""

import ast
import importlib
import inspect
from pathlib import Path

import pytest

import dpr_lab as dpr

MODULES = (
    "run",
    "setup",
    "rig",
    "rig_tables",
    "storage.tables.options:ImportOptions",
    "identification.model",
    "identification.scaling.scale",
    "identification.compare",
    "identification.identifiability",
    "identification.moving_arm.identify:ArmComparison",
    "identification.moving_arm.model",
    "gap.result.diagnosis",
    "gap.result.saved",
    "gap.result.gap_size",
    "gap.result.causes",
    "gap.result.checks",
    "gap.result.gap_budget",
    "acceptance.judge",
    "acceptance.limits",
    "planning.limits",
    "planning.result",
    "workflows.diagnose:DiagnoseRequest",
    "drift.changes",
    "drift.estimates",
    "drift.groups",
)
"""Modules of what `import dpr_lab` exports, and of what its fields hold; after a colon the only class to look at."""


def undocumented(place: str) -> list[str]:
    module, _, only = place.partition(":")
    path = Path(str(importlib.import_module(f"dpr_lab.{module}").__file__))
    missing = []
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if not isinstance(node, ast.ClassDef) or node.name.startswith("_") or only not in ("", node.name):
            continue
        for field, below in zip(node.body, [*node.body[1:], None], strict=True):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                result = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
                if not result and not field.target.id.startswith("_"):
                    missing.append(f"{node.name}.{field.target.id}")
    return missing


@pytest.mark.parametrize("module", MODULES)
def test_every_field_of_a_public_class_is_documented_below_it(module: str) -> None:
    assert undocumented(module) == []


def test_every_public_class_is_in_an_examined_module() -> None:
    classes = [result for name in dpr.__all__ if inspect.isclass(result := getattr(dpr, name))]
    looked_at = {f"dpr_lab.{module.partition(':')[0]}" for module in MODULES} | {"dpr_lab.errors"}
    assert {result.__module__ for result in classes} <= looked_at
