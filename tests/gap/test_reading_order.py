"""The reading order in the docstring of `dpr_lab.gap` names modules that exist, with about their number of words."""

import re
from pathlib import Path

from dpr_lab import gap

FOLDER = Path(gap.__file__).parent


def words(files: list[Path]) -> int:
    return sum(len(file.read_text(encoding="utf-8").split()) for file in files)


def test_the_reading_order_states_its_modules_and_their_length() -> None:
    assert gap.__doc__ is not None
    order = gap.__doc__.partition("Reading order.")[2].partition("Terms")[0]
    _, *parts = re.split(r"([\d,]+) words", order)
    groups = [[FOLDER / f"{name.replace('.', '/')}.py" for name in re.findall(r"`([\w.]+)`", t)] for t in parts[1::2]]
    groups[-1] = [file for file in FOLDER.rglob("*.py") if not any(file in group for group in groups)]
    assert len(groups) == 3
    for stated, files in zip(parts[0::2], groups, strict=True):
        number = int(stated.replace(",", ""))
        assert abs(words(files) - number) < 0.05 * number, words(files)
