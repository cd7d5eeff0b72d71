"""Find and validate TOML files; messages name the file, the key and the value."""

import hashlib
import math
import re
import tomllib
from collections.abc import Sequence
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from dpr_lab.errors import ConfigError, unknown_name
from dpr_lab.whole_file import read_text, regular

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

_PACKAGE = Path(__file__).parent
# An installed wheel contains the built-in files in the package. In a checkout they are in top-level folders.
BUILTIN = _PACKAGE / "builtin" if (_PACKAGE / "builtin").is_dir() else _PACKAGE.parent / "configs"

KEY = "[key]"
"""Last part of the location in a pydantic error that refers to a key itself and not to the value of the key."""

Model = TypeVar("Model", bound=BaseModel)


def find_config(kind: str, name: str | Path, builtin: Path = BUILTIN) -> Path:
    """Find a configuration file by its path, or a built-in file by its bare name.

    Args:
        kind: folder of the built-in files, such as `rigs` or `search`
        name: a path such as `my/rig.toml`, or a built-in name such as `paper`
        builtin: folder that contains the folder `kind`

    Raises:
        ConfigError: there is neither such a file nor such a built-in name.
    """
    path = regular(Path(name), ConfigError)
    if path.is_file():
        return path
    file = builtin / kind / f"{name}.toml"
    if path.name == str(name) and file.is_file():
        return file
    if path.is_dir():
        raise ConfigError(f"{name}: is a folder: give a file in this folder")
    problem = f"{name}: is neither a file nor the name of a built-in {kind.removesuffix('s')}"
    raise ConfigError(unknown_name(problem, str(name), built_in(kind, builtin)))


def built_in(kind: str, builtin: Path = BUILTIN) -> list[str]:
    """Return the names of the built-in files of a kind, such as `rigs` or `search`."""
    return sorted(path.stem for path in (builtin / kind).glob("*.toml"))


def read_config(path: Path, model: type[Model]) -> Model:
    """Read a TOML file into a pydantic model.

    Raises:
        ConfigError: the file is not readable or not TOML, or a key is unknown, missing or out of range; the message has
            one line per fault, which names the file, the key and the value.
    """
    try:
        text = read_text(path, ConfigError, "utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text (byte {error.start}): save it with this encoding") from error
    return parse_config(text, str(path), model)


def parse_config(text: str, source: str, model: type[Model]) -> Model:
    """Validate TOML text with a pydantic model; `source` names the text in messages.

    Raises:
        ConfigError: the text is not TOML, or a key is unknown, missing or out of range.
    """
    try:
        table = tomllib.loads(text)
    except RecursionError as error:
        raise ConfigError(f"{source}: is nested too deeply") from error
    except ValueError as error:  # for example a number with thousands of digits
        raise ConfigError(f"{source}: is not valid TOML: {error}{_line_of(error, text)}") from error
    try:
        return model.model_validate(table)
    except ValidationError as error:
        refused = ConfigError("\n".join(_sentence(source, fault, model) for fault in error.errors()))
        refused.keys = [key_words(fault["loc"]) for fault in error.errors()]
        raise refused from error


def _line_of(error: ValueError, text: str) -> str:
    """Format the line that caused a syntax error, and point out a decimal comma.

    The text is empty if the error names no line.
    """
    if (place := re.search(r"at line (\d+)", str(error))) is None:
        return ""
    line = text.splitlines()[int(place[1]) - 1].strip()
    return f": {line[:60]}" + ("; write numbers with a decimal point" if re.search(r"=\s*-?\d+,\d", line) else "")


def _sentence(path: str, fault: "ErrorDetails", model: type[BaseModel]) -> str:
    shown = "" if isinstance(fault["input"], dict) or fault["loc"][-1:] == (KEY,) else f" = {fault['input']!r}"
    # the location is empty for keys that contradict each other
    place = f"{key_words(fault['loc'])}{shown}: " if fault["loc"] else ""
    sentence = f"{path}: {place}{fault_words(fault)}"
    keys = _keys_of(model, fault["loc"][:-1])
    return unknown_name(sentence, str(fault["loc"][-1]), keys) if fault["type"] == "extra_forbidden" else sentence


def _keys_of(model: type[BaseModel], place: tuple[int | str, ...]) -> list[str]:
    """Return the permitted keys of the table at a location in a file.

    For a list of tables, or a table with arbitrary names, these are the permitted keys of its entries.
    """
    models = {model}
    for part in place:
        fields = [table.model_fields[part].annotation for table in models if part in table.model_fields]
        models = {inner for field in fields for inner in _models_in(field)} or models
    return sorted({key for table in models for key in table.model_fields})


def _models_in(annotation: Any) -> set[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {annotation}
    return {inner for part in get_args(annotation) for inner in _models_in(part)}


def first_fault(error: ValidationError) -> str:
    """Describe the first key that pydantic refused, for example `ratios.a/b: must be greater than 0`."""
    fault = error.errors()[0]
    return f"{key_words(fault['loc']) or 'the file'}: {fault_words(fault)}"


def key_words(location: Sequence[int | str]) -> str:
    """Describe a location in a file, for example `masses, entry 2, rod`.

    Entries of a list are counted from 1.
    """
    location = [part for part in location if part != KEY]
    parts = [f"entry {part + 1}" if isinstance(part, int) else part for part in location]
    separators = [
        ", " if isinstance(part, int) or isinstance(before, int) else "." for before, part in pairwise(location)
    ]
    return "".join(chain.from_iterable(zip(parts, [*separators, ""], strict=False)))


def fault_words(fault: "ErrorDetails") -> str:
    """Describe why a pydantic model refused a value, for example `must be greater than 0`."""
    kind = {"extra_forbidden": "unknown key", "missing": "is missing"}.get(fault["type"])
    if fault["type"] == "too_short":
        kind = f"has too few entries: at least {fault.get('ctx', {}).get('min_length', 1)}"
    if fault["type"] in ("tuple_type", "list_type"):
        kind = "must be a list in square brackets"
    if fault["type"] in ("model_type", "dict_type"):
        kind = "must be a table of keys and values"
    if isinstance(fault["input"], float) and math.isnan(fault["input"]):
        kind = "must be a finite number"
    text = str(fault["msg"]).removeprefix("Value error, ")
    return kind or text.replace("Input should be", "must be", 1)


def sha256_of(path: Path) -> str:
    """Compute the SHA-256 of the content of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
