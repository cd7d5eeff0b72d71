"""XML with texts that come from files."""

import re
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

_NO_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")
"""Characters that XML 1.0 cannot hold in any spelling."""


def in_xml(text: str) -> str:
    """The text in characters that XML can hold."""
    return _NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)


def element(parent: Element | None, tag: str, **attributes: str) -> Element:
    """A new element; its attributes are escaped."""
    safe = {key: in_xml(value) for key, value in attributes.items()}
    return Element(tag, safe) if parent is None else SubElement(parent, tag, safe)


def comment(parent: Element, text: str) -> None:
    """A comment, which may hold neither two hyphens in a row nor one at its end."""
    unbroken = in_xml(text).replace("-", "\N{NON-BREAKING HYPHEN}")
    parent.append(Comment(f" {unbroken} "))


def text_of(root: Element) -> str:
    """The document."""
    indent(root)
    return tostring(root, encoding="unicode") + "\n"
