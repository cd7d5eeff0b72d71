import json
from pathlib import Path

from dpr_lab.report.plain import as_json


def test_what_is_not_finite_becomes_null_and_everything_else_stays() -> None:
    told = {"rms": float("nan"), "range": (1.0, float("inf")), 5: {"file": Path("a/b"), "ok": True}}
    assert json.loads(as_json(told)) == {"rms": None, "range": [1.0, None], "5": {"file": "a/b", "ok": True}}
