"""Change attributes in the text of an XML file; everything else is unchanged, byte for byte."""

import re
from dataclasses import dataclass
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.xml_file import parse_xml


@dataclass(slots=True)
class StartTag:
    """Position of a start tag in the text."""

    tag: str
    attributes: dict[str, str]
    parent: int
    """Index of its parent element; -1: none."""
    first: int
    """Position of its `<`, bytes."""


@dataclass(frozen=True, slots=True)
class ChangedAttribute:
    """One changed number of the file."""

    element: str
    attribute: str
    before: str
    """Old value; empty if the attribute was missing."""
    after: str


class XmlEdit:
    """Text of a file with pending changes."""

    def __init__(self, data: bytes, name: str) -> None:
        """Raises: ConfigError: as for `parse_xml`, or another encoding than UTF-8."""
        parse_xml(data, name)
        try:
            data.decode("utf-8")
        except UnicodeDecodeError as error:
            raise ConfigError(f"{name}: is not in UTF-8, which is needed to change it") from error
        self.data, self.changes = data, []
        self.tags: list[StartTag] = []
        self._new: dict[int, dict[str, str]] = {}
        self._inserted: dict[int, str] = {}
        parser, open_tags = expat.ParserCreate(), [-1]

        def start(tag: str, attributes: dict[str, str]) -> None:
            self.tags.append(StartTag(tag, attributes, open_tags[-1], parser.CurrentByteIndex))
            open_tags.append(len(self.tags) - 1)

        parser.StartElementHandler = start
        parser.EndElementHandler = lambda _: open_tags.pop()
        parser.Parse(data, True)

    changes: list[ChangedAttribute]

    def find(self, tag: str, **attributes: str) -> int | None:
        """Index of the first element with these attributes; None without one."""
        wanted = attributes.items()
        return next((i for i, t in enumerate(self.tags) if t.tag == tag and wanted <= t.attributes.items()), None)

    def child(self, parent: int, tag: str) -> int | None:
        """Index of the first child with this tag; None without one."""
        return next((i for i, t in enumerate(self.tags) if t.tag == tag and t.parent == parent), None)

    def set(self, index: int, label: str, **attributes: str) -> None:
        """Set attributes of an element."""
        for name, value in attributes.items():
            before = self.tags[index].attributes.get(name, "")
            if before != value:
                self.changes.append(ChangedAttribute(label, name, before, value))
                self._new.setdefault(index, {})[name] = value

    def insert(self, parent: int, tag: str, label: str, **attributes: str) -> None:
        """Insert an element at the beginning of another."""
        text = " ".join(f"{name}={quoteattr(value)}" for name, value in attributes.items())
        self._inserted[parent] = f"<{tag} {text}/>"
        self.changes += [ChangedAttribute(label, name, "", value) for name, value in attributes.items()]

    def text(self) -> bytes:
        """The file with the changes applied."""
        data = self.data
        for index in sorted({*self._new, *self._inserted}, reverse=True):
            first = self.tags[index].first
            last = _end_of_tag(data, first)
            tag = data[first:last].decode("utf-8")
            for name, value in self._new.get(index, {}).items():
                tag = _with_attribute(tag, name, value)
            data = data[:first] + (tag + self._insertion(index, data, first)).encode("utf-8") + data[last:]
        return data

    def _insertion(self, index: int, data: bytes, first: int) -> str:
        """The inserted element on its own line, indented by two more spaces than its parent."""
        if index not in self._inserted:
            return ""
        line = data[data.rfind(b"\n", 0, first) + 1 : first].decode("utf-8")
        indent = line if not line.strip() else ""
        return f"\n{indent}  {self._inserted[index]}"


def _end_of_tag(data: bytes, first: int) -> int:
    """Position after the `>` of a start tag, ignoring any inside quotes."""
    quote = 0
    for place in range(first, len(data)):
        byte = data[place]
        if quote:
            quote = 0 if byte == quote else quote
        elif byte in b"\"'":
            quote = byte
        elif byte == ord(">"):
            return place + 1
    raise ValueError("no end of tag")


def _with_attribute(tag: str, name: str, value: str) -> str:
    quoted = quoteattr(value)
    attribute = re.compile(rf"(?<=\s){re.escape(name)}\s*=\s*(\"[^\"]*\"|'[^']*')")
    if attribute.search(tag):
        return attribute.sub(lambda _: f"{name}={quoted}", tag, count=1)
    end = "/>" if tag.endswith("/>") else ">"
    return f"{tag[: -len(end)].rstrip()} {name}={quoted}{end}"
