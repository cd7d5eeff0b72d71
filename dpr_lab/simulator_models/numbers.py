"""Numbers in the files of simulators: each must be a finite decimal number before a format's library sees it.

The libraries read some of them as another number: `1,5` is 1.0 to SDFormat's, and an empty one is zero to MuJoCo.
"""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

from dpr_lab.errors import ConfigError

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_INFINITY = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)


def refuse_bad_attributes(root: Element, names: frozenset[str], path: Path) -> None:
    """Check the attributes with these names.

    Raises:
        ConfigError: one of them holds something else than finite numbers; names file, element and attribute.
    """
    for label, element in _labelled(root):
        for name in names & set(element.attrib):
            if problem := _problem(element.attrib[name]):
                raise ConfigError(f"{path}: <{element.tag}>{label}: attribute {name}: {problem}")


def refuse_bad_texts(root: Element, keys: Mapping[str, frozenset[str]], unbounded: frozenset[str], path: Path) -> None:
    """Check the texts of elements.

    Args:
        root: of the file
        keys: element -> its children that hold numbers
        unbounded: names of children that may be infinite
        path: the file

    Raises:
        ConfigError: one of them holds something else than finite numbers; names file, elements and the text.
    """
    for label, element in _labelled(root):
        for child in element:
            if child.tag in keys.get(element.tag, ()):
                text = child.text or ""
                if child.tag in unbounded and _INFINITY.fullmatch(text.strip()):
                    continue
                if child.tag == "pose" and not text.strip():  # at the frame that it is relative to
                    continue
                if problem := _problem(text):
                    raise ConfigError(f"{path}: <{element.tag}>{label}: element <{child.tag}>: {problem}")


def _problem(text: str) -> str:
    """What is wrong with the numbers of a text; empty: nothing."""
    parts = text.split()
    if not parts:
        return "is empty: give a number, or leave it out"
    bad = next((part for part in parts if not _NUMBER.fullmatch(part) or not math.isfinite(float(part))), None)
    return "" if bad is None else f"{bad[:50]!r} is not a finite number: write it as 1.5 or 1e-3"


def _labelled(root: Element) -> Iterator[tuple[str, Element]]:
    """Every element, with words for its own name or that of the nearest named element around it."""
    waiting = [("", root)]
    while waiting:
        label, element = waiting.pop()
        name = element.get("name")
        own = f" {name[:50]!r}" if name else label
        yield own, element
        around = f" of {element.tag} {name[:50]!r}" if name else label
        waiting += [(around, child) for child in reversed(element)]
