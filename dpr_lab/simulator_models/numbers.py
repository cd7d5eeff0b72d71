"""Check the numbers in a simulator file before a library reads the file.

The libraries accept invalid numbers. The library of SDFormat reads `1,5` as 1.0, and MuJoCo reads an empty text as
zero.
"""

import math
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

from dpr_lab.errors import ConfigError

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_INFINITY = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)


def refuse_bad_attributes(
    root: Element, names: frozenset[str], path: Path, words: Collection[str] = frozenset()
) -> None:
    """Check the numbers in the attributes with the given names.

    Elements with a tag in `words` are not checked, because their attributes are not numbers.

    Raises:
        ConfigError: an attribute contains something other than finite numbers; the message names file, element and
            attribute.
    """
    for label, element in _labelled(root):
        for name in names & set(element.attrib) if element.tag not in words else ():
            if problem := _problem(element.attrib[name]):
                raise ConfigError(f"{path}: <{element.tag}>{label}: attribute {name}: {problem}")


def refuse_bad_texts(root: Element, keys: Mapping[str, frozenset[str]], unbounded: frozenset[str], path: Path) -> None:
    """Check the numbers in the texts of elements.

    Args:
        root: root element of the file
        keys: names of the children that contain numbers, by the name of the element
        unbounded: names of children that may be infinite
        path: the file

    Raises:
        ConfigError: a text contains something other than finite numbers; the message names file, elements and text.
    """
    for label, element in _labelled(root):
        for child in element:
            if child.tag in keys.get(element.tag, ()):
                text = child.text or ""
                if child.tag in unbounded and _INFINITY.fullmatch(text.strip()):
                    continue
                if child.tag == "pose" and not text.strip():  # an empty pose only names a reference frame
                    continue
                if problem := _problem(text):
                    raise ConfigError(f"{path}: <{element.tag}>{label}: element <{child.tag}>: {problem}")


def _problem(text: str) -> str:
    """Describe an invalid number in a text; the result is empty for valid numbers."""
    parts = text.split()
    if not parts:
        return "is empty: give a number, or remove the entry"
    bad = next((part for part in parts if not _NUMBER.fullmatch(part) or not math.isfinite(float(part))), None)
    return "" if bad is None else f"{bad[:50]!r} is not a finite number: write it as 1.5 or 1e-3"


def _labelled(root: Element) -> Iterator[tuple[str, Element]]:
    """Yield every element with a label for messages.

    The label contains the name of the element, or the name of its nearest ancestor that has a name.
    """
    waiting = [("", root)]
    while waiting:
        label, element = waiting.pop()
        name = element.get("name")
        name_text = f" {name[:50]!r}" if name else label
        yield name_text, element
        around = f" of {element.tag} {name[:50]!r}" if name else label
        waiting += [(around, child) for child in reversed(element)]
