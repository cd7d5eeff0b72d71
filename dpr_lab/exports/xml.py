"""XML output with texts from files."""

import re
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

_NO_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")
"""Pattern of characters that XML 1.0 cannot contain, even escaped."""


def in_xml(text: str) -> str:
    """The text without characters that XML cannot contain."""
    return _NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)


def element(parent: Element | None, tag: str, **attributes: str) -> Element:
    """A new element; its attributes are escaped."""
    safe = {key: in_xml(value) for key, value in attributes.items()}
    return Element(tag, safe) if parent is None else SubElement(parent, tag, safe)


def comment(parent: Element, text: str) -> None:
    """A comment, without two consecutive hyphens or a hyphen at its end."""
    unbroken = in_xml(text).replace("-", "\N{NON-BREAKING HYPHEN}")
    parent.append(Comment(f" {unbroken} "))


def text_of(root: Element) -> str:
    """The document as text."""
    indent(root)
    return tostring(root, encoding="unicode") + "\n"
