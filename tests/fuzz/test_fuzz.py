"""Short run of all fuzz targets: the corpus, mutations of the corpus, and random bytes."""

import runpy
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.thinned import FULL

FUZZ = Path(__file__).parents[2] / "fuzz"
TARGETS = runpy.run_path(str(FUZZ / "targets.py"))["TARGETS"]
CORPUS = {name: sorted((FUZZ / "corpus" / name).iterdir()) for name in TARGETS}
LARGEST_CORPUS_BYTES = 100_000


@pytest.mark.parametrize("path", [path for paths in CORPUS.values() for path in paths], ids=lambda path: path.name)
def test_inputs_that_once_failed_are_handled(path: Path) -> None:
    TARGETS[path.parent.name](path.read_bytes())


@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=40 if FULL else 20)
@given(data=st.binary(max_size=600))
def test_random_bytes_are_refused_with_the_expected_error(name: str, data: bytes) -> None:
    TARGETS[name](data)


instead = st.one_of(st.binary(max_size=30), st.sampled_from([b"\n", b"1e999", b"[" * 3000, b"9" * 400]))
edits = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 40), instead), min_size=1, max_size=8)
"""Where, how many bytes go, what comes instead."""


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
@settings(max_examples=60 if FULL else 30)
@given(data=st.data())
def test_damaged_files_are_refused_with_the_expected_error(name: str, data: st.DataObject) -> None:
    content = data.draw(st.sampled_from(CORPUS[name])).read_bytes()
    for share, length, inserted in data.draw(edits):
        at = int(share * len(content))
        content = content[:at] + inserted + content[at + length :]
    TARGETS[name](content)


def test_the_corpus_stays_small_and_every_target_has_one() -> None:
    assert all(CORPUS.values())
    assert sum(path.stat().st_size for paths in CORPUS.values() for path in paths) < LARGEST_CORPUS_BYTES
