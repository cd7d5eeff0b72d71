import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dpr_lab.report.plain import NotFinite, as_json

RESULTS = st.recursive(
    st.none() | st.booleans() | st.integers(-1000, 1000) | st.floats() | st.text(max_size=5),
    lambda parts: st.lists(parts, max_size=4) | st.dictionaries(st.text(max_size=3), parts, max_size=4),
    max_leaves=12,
)


def test_paths_and_keys_become_text_and_everything_else_stays() -> None:
    result = {"rms": 0.5, "range": (1.0, None), 5: {"file": Path("a/b"), "ok": True}}
    assert json.loads(as_json(result)) == {"rms": 0.5, "range": [1.0, None], "5": {"file": "a/b", "ok": True}}


def test_a_number_that_is_not_finite_fails_loudly_with_its_key() -> None:
    with pytest.warns(NotFinite, match=r"result\.gap\.range\[1\] is inf"):
        assert json.loads(as_json({"gap": {"range": (1.0, math.inf)}})) == {"gap": {"range": [1.0, None]}}


def _finite(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return all(map(_finite, parts))


@pytest.mark.slow
@given(st.dictionaries(st.text(max_size=3), RESULTS, max_size=4))
def test_any_result_is_written_as_it_is_or_warned_of(result: dict) -> None:
    if _finite(result):
        assert json.loads(as_json(result)) == result
    else:
        with pytest.warns(NotFinite):
            assert _finite(json.loads(as_json(result)))
