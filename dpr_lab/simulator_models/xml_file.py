"""Read untrusted XML files.

Entities, document types, and includes from outside the folder of the model are refused.
"""

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import regular


@dataclass(frozen=True, slots=True)
class XmlLimits:
    """Limits for the files of a pendulum model."""

    bytes: int = 5_000_000
    """Maximum size of one file, bytes."""
    depth: int = 100
    """Maximum nesting depth of elements."""
    files: int = 50
    """Maximum number of files included by one model."""


XML_LIMITS = XmlLimits()


def read_xml(path: Path, text: bytes | None = None) -> Element:
    """Parse a file without its comments.

    If `text` is given, it replaces the content of the file.

    Raises:
        ConfigError: the file cannot be read, is too large or nested too deeply, is not well-formed, or declares a
            document type or entities.
    """
    if text is not None:
        return parse_xml(text, str(path))
    try:
        with regular(path, ConfigError).open("rb") as file:
            content = file.read(XML_LIMITS.bytes + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from error
    if len(content) > XML_LIMITS.bytes:
        raise ConfigError(
            f"{path}: is larger than {XML_LIMITS.bytes // 1_000_000} MB; too large for a model of a pendulum"
        )
    return parse_xml(content, str(path))


def parse_xml(content: bytes, name: str) -> Element:
    """Parse a document; `name` is the name of the document in messages.

    Raises:
        ConfigError: as for `read_xml`.
    """
    builder, depth = TreeBuilder(), 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > XML_LIMITS.depth:
            raise ConfigError(f"{name}: elements are nested more than {XML_LIMITS.depth} deep")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise ConfigError(f"{name}: declares a document type or entities, which are not read: remove <!DOCTYPE ...>")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise ConfigError(f"{name}: is not well-formed XML: {error}") from error
    return builder.close()


def with_includes(path: Path, content: bytes | None = None) -> Element:
    """Read a document, and replace each `<include file="...">` by the content of the included file.

    If `content` is given, it is used instead of the content of the document.

    Raises:
        ConfigError: an include is outside the folder of the model or includes itself, or there are too many.
    """
    root = read_xml(path) if content is None else parse_xml(content, str(path))
    folder = path.resolve().parent
    _include(root, path, folder, (path.resolve(),), [0])
    return root


def _include(parent: Element, path: Path, folder: Path, above: tuple[Path, ...], count: list[int]) -> None:
    for index in range(len(parent) - 1, -1, -1):
        child = parent[index]
        if child.tag != "include":
            _include(child, path, folder, above, count)
            continue
        name = child.get("file", "")
        if not name.strip():
            raise ConfigError(f"{path}: <include> has no attribute file")
        place = f'{path}: <include file="{name[:200]}">'
        file = _inside(folder / name, folder, place)
        if not file.exists():
            raise ConfigError(f"{place}: there is no such file: copy it there, or remove the element")
        if file in above:
            raise ConfigError(f"{place} includes itself")
        count[0] += 1
        if count[0] > XML_LIMITS.files or len(above) > XML_LIMITS.files:
            raise ConfigError(f"{path}: includes more than {XML_LIMITS.files} files")
        content = read_xml(file)
        _include(content, path, folder, (*above, file), count)
        parent[index : index + 1] = list(content)


def _inside(file: Path, folder: Path, place: str) -> Path:
    """Return the path of a file with resolved symbolic links.

    Raises:
        ConfigError: the file is outside the folder.
    """
    try:
        real = file.resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise ConfigError(f"{place}: cannot be read: {error}") from error
    if not real.is_relative_to(folder):
        raise ConfigError(f"{place}: is outside the folder of the model and is not read: copy the file into it")
    return real
