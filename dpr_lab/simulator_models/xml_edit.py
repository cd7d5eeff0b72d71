"""Change attributes and texts in an XML file; all other bytes remain unchanged."""

import re
from dataclasses import dataclass
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.xml_file import parse_xml

_START_TAG = re.compile(rb"""(?:[^"'>]|"[^"]*"|'[^']*')*>""")


@dataclass(slots=True)
class StartTag:
    """Start tag of an element and its position in the text."""

    tag: str
    attributes: dict[str, str]
    parent: int
    """Index of the parent element; -1 for the root element."""
    first: int
    """Position of its `<` in the file, bytes."""
    end: int = -1
    """Position of the end tag, bytes; for an empty element, the position of the start tag."""
    text: str = ""
    """Text of the element, without the text of its children."""
    children: int = 0


@dataclass(frozen=True, slots=True)
class ChangedAttribute:
    """A changed number of a file."""

    element: str
    """Description of the element."""
    attribute: str
    """Name of the attribute."""
    before: str
    """Old value; empty if the attribute was missing."""
    after: str
    """New value."""


class XmlEdit:
    """Text of a file and its pending changes."""

    def __init__(self, content: bytes, name: str) -> None:
        """Read the positions of all elements.

        Raises:
            ConfigError: as for `parse_xml`, or the encoding is not UTF-8.
        """
        parse_xml(content, name)
        try:
            content.decode("utf-8")
        except UnicodeDecodeError as error:
            raise ConfigError(f"{name}: is not encoded in UTF-8: save it with this encoding") from error
        self.data, self.changes = content, []
        self.tags: list[StartTag] = []
        self._new: dict[int, dict[str, str]] = {}
        self._texts: dict[int, str] = {}
        self._inserted: dict[int, list[str]] = {}
        parser, open_tags = expat.ParserCreate(), [-1]

        def start(tag: str, attributes: dict[str, str]) -> None:
            if open_tags[-1] >= 0:
                self.tags[open_tags[-1]].children += 1
            self.tags.append(StartTag(tag, attributes, open_tags[-1], parser.CurrentByteIndex))
            open_tags.append(len(self.tags) - 1)

        def end(tag: str) -> None:
            self.tags[open_tags.pop()].end = parser.CurrentByteIndex

        def text(content: str) -> None:
            self.tags[open_tags[-1]].text += content

        parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
        parser.Parse(content, True)

    changes: list[ChangedAttribute]

    def find(self, tag: str, **attributes: str) -> int | None:
        """Return the index of the first element with this tag and attributes, or None."""
        required = attributes.items()
        return next((i for i, t in enumerate(self.tags) if t.tag == tag and required <= t.attributes.items()), None)

    def child(self, parent: int, tag: str) -> int | None:
        """Return the index of the first child with this tag, or None."""
        return next((i for i, t in enumerate(self.tags) if t.tag == tag and t.parent == parent), None)

    def set(self, index: int, label: str, **attributes: str) -> None:
        """Set attributes of an element; `label` describes the element in the list of changes."""
        for name, value in attributes.items():
            before = self.tags[index].attributes.get(name, "")
            if before != value:
                self.changes.append(ChangedAttribute(label, name, before, value))
                self._new.setdefault(index, {})[name] = value

    def set_text(self, index: int, label: str, value: str) -> None:
        """Set the text of an element.

        Raises:
            ConfigError: the element contains children or comments.
        """
        tag = self.tags[index]
        if tag.children or b"<" in self._content(index):
            raise ConfigError(
                f"<{tag.tag}> of {label} contains more than text: remove the rest so that it can be changed"
            )
        if tag.text.strip() != value:
            self.changes.append(ChangedAttribute(label, tag.tag, tag.text.strip(), value))
            self._texts[index] = value

    def insert(self, parent: int, tag: str, label: str, **attributes: str) -> None:
        """Insert an element at the beginning of another element."""
        text = " ".join(f"{name}={quoteattr(value)}" for name, value in attributes.items())
        self._inserted.setdefault(parent, []).append(f"<{tag} {text}/>")
        self.changes += [ChangedAttribute(label, name, "", value) for name, value in attributes.items()]

    def insert_texts(self, parent: int, label: str, within: str = "", **texts: str) -> None:
        """Insert elements with texts at the beginning of an element.

        If `within` is given, the elements are inserted in a new element of this name.
        """
        elements = [f"<{tag}>{escape(value)}</{tag}>" for tag, value in texts.items()]
        elements = [f"<{within}>{''.join(elements)}</{within}>"] if within else elements
        self._inserted.setdefault(parent, []).extend(elements)
        self.changes += [ChangedAttribute(label, tag, "", value) for tag, value in texts.items()]

    def text(self) -> bytes:
        """Return the content of the file with the changes."""
        content = self.data
        for index in sorted({*self._new, *self._inserted, *self._texts}, reverse=True):
            first = self.tags[index].first
            last = _end_of_tag(content, first)
            tag = content[first:last].decode("utf-8")
            for name, value in self._new.get(index, {}).items():
                tag = _with_attribute(tag, name, value)
            remaining = content[last:]
            if index in self._texts:
                remaining = remaining[len(self._content(index)) :]
            within = self._insertion(index, content, first) + escape(self._texts.get(index, ""))
            if within and tag.endswith("/>"):
                tag, within = tag[:-2].rstrip() + ">", f"{within}</{self.tags[index].tag}>"
            content = content[:first] + (tag + within).encode("utf-8") + remaining
        return content

    def _content(self, index: int) -> bytes:
        """Return the content of an element: the bytes between its tags."""
        tag = self.tags[index]
        return self.data[_end_of_tag(self.data, tag.first) : max(tag.end, _end_of_tag(self.data, tag.first))]

    def _insertion(self, index: int, content: bytes, first: int) -> str:
        """Return the text of the inserted elements.

        Each element is on a separate line, and is indented by two more spaces than its parent.
        """
        if index not in self._inserted:
            return ""
        line = content[content.rfind(b"\n", 0, first) + 1 : first].decode("utf-8")
        indent = line if not line.strip() else ""
        return "".join(f"\n{indent}  {element}" for element in self._inserted[index])


def _end_of_tag(content: bytes, first: int) -> int:
    """Return the position after the `>` of a start tag, ignoring `>` in quotes."""
    tag = _START_TAG.match(content, first)
    assert tag is not None
    return tag.end()


def _with_attribute(tag: str, name: str, value: str) -> str:
    quoted = quoteattr(value)
    attribute = re.compile(rf"(?<=\s){re.escape(name)}\s*=\s*(\"[^\"]*\"|'[^']*')")
    if attribute.search(tag):
        return attribute.sub(lambda _: f"{name}={quoted}", tag, count=1)
    end = "/>" if tag.endswith("/>") else ">"
    return f"{tag[: -len(end)].rstrip()} {name}={quoted}{end}"
