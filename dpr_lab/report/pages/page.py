"""Create HTML pages of text, tables and figures, rendered by one Jinja2 template.

A page is a single file: figures are embedded, and no other file is loaded.
"""

import base64
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, ParamSpec

from dpr_lab.errors import printable
from dpr_lab.report.pages.terms import TERMS
from dpr_lab.whole_file import write_whole

if TYPE_CHECKING:
    from jinja2 import Environment


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph; `style` is a class of the style sheet."""

    kind: ClassVar = "paragraph"
    text: str
    style: str = ""


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading inside a section."""

    kind: ClassVar = "heading"
    text: str


@dataclass(frozen=True, slots=True)
class Items:
    """A list of sentences. A page omits an empty list."""

    kind: ClassVar = "items"
    sentences: Sequence[str]
    numbered: bool = False

    def __bool__(self) -> bool:
        return len(self.sentences) > 0


@dataclass(frozen=True, slots=True)
class PageTable:
    """Table of text; the first column contains row headers. A page omits a table without rows."""

    kind: ClassVar = "table"
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    style: str = ""
    """Class of the style sheet: `prose` wraps cells, `hash` shows the last column in a small monospace font."""
    title: str = ""
    """Title under which the table is folded; empty for a table that is not folded."""

    def __bool__(self) -> bool:
        return len(self.rows) > 0


P = ParamSpec("P")
Rows = Sequence[Sequence[str]]


def page_table(
    *columns: str, caption: str = "", style: str = "", title: str = ""
) -> Callable[[Callable[P, Rows]], Callable[P, PageTable]]:
    """Decorate a function that returns rows of text; the decorated function returns their table."""

    def with_columns(rows: Callable[P, Rows]) -> Callable[P, PageTable]:
        @wraps(rows)
        def table(*args: P.args, **kwargs: P.kwargs) -> PageTable:
            return PageTable(columns, rows(*args, **kwargs), caption, style, title)

        return table

    return with_columns


@dataclass(frozen=True, slots=True)
class Picture:
    """An embedded PNG file with its text alternative and caption."""

    kind: ClassVar = "picture"
    name: str
    path: Path
    alternative: str
    caption: str

    @property
    def data(self) -> str:
        """Content of the file, encoded in base64."""
        return base64.b64encode(self.path.read_bytes()).decode("ascii")


@dataclass(frozen=True, slots=True)
class Definitions:
    """Pairs of a term and its definition."""

    kind: ClassVar = "definitions"
    pairs: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Formula:
    """Lines of preformatted text."""

    kind: ClassVar = "formula"
    lines: Sequence[str]


@dataclass(frozen=True, slots=True)
class ShareBar:
    """Stacked horizontal bar of shares with a legend."""

    kind: ClassVar = "bar"
    title: str
    parts: Sequence[tuple[str, float]]
    """Legend and share of each part. The shares add up to 1, and the last part is the remainder."""


Block = Paragraph | Heading | Items | PageTable | Picture | Definitions | Formula | ShareBar | str
"""One part of a section; a string is a paragraph."""


@dataclass(frozen=True, slots=True)
class Section:
    """Section of a page.

    The blocks of the section are folded under the heading unless the section is open.
    """

    title: str
    blocks: Sequence[Block | None]
    name: str = ""
    """The `id` of the section on the page."""
    is_open: bool = False


_GLOSSARY = Paragraph("The glossary of the documentation (docs/glossary.md) defines all terms.", "soft")


def page_html(
    title: str, summary: str, sections: Iterable[Section], *, lead: Sequence[Block] = (), footer: str = ""
) -> str:
    """Render a page.

    Args:
        title: heading of the page
        summary: the result in at most three sentences
        sections: sections in their order; sections without content are omitted
        lead: blocks between the summary and the first section
        footer: last line of the page
    """
    shown = [section for section in sections if any(section.blocks)]
    columns = (
        column
        for block in (*lead, *(block for section in shown for block in section.blocks))
        if block and isinstance(block, PageTable)
        for column in block.columns
    )
    terms = {column: TERMS[column] for column in columns if column in TERMS}
    if terms:
        shown.append(Section("Terms", [Definitions(terms), _GLOSSARY], "terms"))
    template = _environment().get_template("page.html")
    return template.render(title=title, summary=summary, lead=lead, sections=shown, terms=terms, footer=footer) + "\n"


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # not needed for tables on a terminal

    environment = Environment(
        loader=PackageLoader("dpr_lab.report.pages"),
        autoescape=True,
        finalize=_printable,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["code"] = _with_code
    return environment


def _with_code(text: str) -> Any:
    """Escape a text, and convert parts between backticks to code."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(_printable(text)))))


def _printable(value: Any) -> Any:
    """Escape control characters in plain text; keep numbers and per cent signs together.

    Markup is returned unchanged. Jinja2 escapes plain text later.
    """
    is_text = isinstance(value, str) and not hasattr(value, "__html__")
    return re.sub(r"(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", printable(value)) if is_text else value


def write_page(page: str, path: Path) -> Path:
    """Write a page, and return the path of its file.

    Raises:
        DprError: the folder or the file cannot be written.
    """
    # A file name may contain bytes that are not text; the page must be valid UTF-8 nevertheless.
    write_whole(path, lambda file: file.write_bytes(page.encode("utf-8", "replace")))
    return path


def pictures(paths: Mapping[str, Path], captions: Mapping[str, tuple[str, str]]) -> dict[str, Picture]:
    """Create pictures by name, each with its text alternative and caption."""
    return {name: Picture(name, path, *captions[name]) for name, path in paths.items()}
