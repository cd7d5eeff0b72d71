"""Parts that every HTML page is made of; a page carries its figures and fetches nothing."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path

from dpr_lab.report.plain import escaped
from dpr_lab.whole_file import write_whole


def template() -> str:
    """The head with its style, and the body of the report of an identification."""
    return files("dpr_lab.report").joinpath("template.html").read_text(encoding="utf-8")


def page_html(title: str, summary: str, sections: Iterable[str]) -> str:
    """A page: its title, the result in a sentence, and whatever follows."""
    head = template().split("<body>")[0].replace("$title", escaped(title))
    header = f'<header>\n<h1>{escaped(title)}</h1>\n<p class="summary">{escaped(summary)}</p>\n</header>'
    body = "\n".join(section for section in sections if section)
    return f"{head}<body>\n{header}\n<main>\n{body}\n</main>\n</body>\n</html>\n"


def write_page(page: str, path: Path) -> Path:
    """Write a page; its path.

    Raises:
        DprError: the folder or the file cannot be written.
    """
    # A file name may hold bytes that are no text; the page stays valid UTF-8.
    write_whole(path, lambda file: file.write_bytes(page.encode("utf-8", "replace")))
    return path


def section_html(title: str, *parts: str) -> str:
    """A section with its heading."""
    body = "\n".join(part for part in parts if part)
    return f"<section>\n<h2>{escaped(title)}</h2>\n{body}\n</section>"


def paragraph_html(sentence: str, style: str = "") -> str:
    """A paragraph; nothing where there is no sentence."""
    named = f' class="{style}"' if style else ""
    return f"<p{named}>{escaped(sentence)}</p>" if sentence else ""


def details_html(title: str, body: str) -> str:
    """What a switch unfolds on a screen, and is there in print; beside the switch, whose own content browsers hide."""
    return f'<details>\n<summary>{escaped(title)}</summary>\n</details>\n<div class="folded">\n{body}\n</div>'


def list_html(sentences: Sequence[str], *, numbered: bool = False) -> str:
    """A list of sentences; nothing where there are none."""
    items, tag = "\n".join(f"<li>{escaped(sentence)}</li>" for sentence in sentences), "ol" if numbered else "ul"
    return f"<{tag}>\n{items}\n</{tag}>" if sentences else ""


def table_html(columns: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "", style: str = "") -> str:
    """A table of text."""
    head = "".join(f'<th scope="col">{escaped(column)}</th>' for column in columns)
    body = "\n".join(f"<tr>{_row(row)}</tr>" for row in rows)
    title = f"<caption><span>{escaped(caption)}</span></caption>\n" if caption else ""
    named = f' class="{style}"' if style else ""
    return (
        f'<div class="scroll" tabindex="0"><table{named}>\n{title}<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def figures_html(paths: Mapping[str, Path], said: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    """Figures that carry their pictures, by name.

    Args:
        paths: the picture of each
        said: of each a text for readers who do not see it, and its caption
    """
    return {name: _figure(name, path, *said[name]) for name, path in paths.items()}


def _figure(name: str, path: Path, alternative: str, caption: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return (
        f'<figure id="{name}">\n<img alt="{escaped(alternative)}" src="data:image/png;base64,{data}">\n'
        f"<figcaption>{escaped(caption)}</figcaption>\n</figure>"
    )


def _row(cells: Sequence[str]) -> str:
    first, *rest = (escaped(cell) for cell in cells)
    return f'<th scope="row">{first}</th>' + "".join(f"<td>{cell}</td>" for cell in rest)
