"""Link URLs: scheme://place?option=value, with a sentence for every slip."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from dpr_lab.errors import LinkUrlError


@dataclass(frozen=True, slots=True)
class LinkUrl:
    """A link URL taken apart."""

    text: str
    """As the operator wrote it."""
    scheme: str
    host: str
    """Between `//` and the first slash, upper and lower case kept: `COM3`, `slcan`, `127.0.0.1:5555`."""
    path: str
    """From the first slash on, or empty."""
    query: tuple[tuple[str, str], ...]

    def options(self, known: Mapping[str, Callable[[str], Any]]) -> dict[str, Any]:
        """The query's values, read by the reader of each known option.

        Args:
            known: option name -> reader of its text, which raises ValueError("is not ...")

        Raises:
            LinkUrlError: an option that is unknown, repeated or unreadable.
        """
        parameters: dict[str, Any] = {}
        for name, text in self.query:
            if name not in known:
                names = ", ".join(known) or "none"
                raise LinkUrlError(f"{self.text}: unknown option {name!r} (this kind of link knows: {names})")
            if name in parameters:
                raise LinkUrlError(f"{self.text}: option {name!r} is given twice")
            try:
                parameters[name] = known[name](text)
            except ValueError as error:
                raise LinkUrlError(f"{self.text}: {name} = {text!r}: {error}") from error
        return parameters


def parse_url(text: str) -> LinkUrl:
    """Take a link URL apart.

    Raises:
        LinkUrlError: the text is not of the form scheme://place?option=value.
    """
    try:
        split = urlsplit(text)
        query = tuple(parse_qsl(split.query, keep_blank_values=True, strict_parsing=bool(split.query)))
    except ValueError as error:
        raise LinkUrlError(f"{text}: is not a link URL ({error}); write scheme://place?option=value") from error
    if "://" not in text:
        raise LinkUrlError(f"{text}: is not a link URL; write for example serial:///dev/ttyUSB0?baud=921600 or sim://")
    return LinkUrl(text, split.scheme, split.netloc, split.path, query)


def whole_number(text: str) -> int:
    """A positive whole number, such as a baud rate."""
    if not (text.isascii() and text.isdigit()) or int(text) == 0:
        raise ValueError("is not a positive whole number")
    return int(text)


def seconds(text: str) -> float:
    """A time in s, not negative."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise ValueError("is not a time in seconds")
    return value


def one_of(*choices: str) -> Callable[[str], str]:
    """A reader that accepts only the given words."""

    def read(text: str) -> str:
        if text not in choices:
            raise ValueError(f"is not one of {', '.join(choices)}")
        return text

    return read
