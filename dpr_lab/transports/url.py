"""Link URLs of the form scheme://place?option=value, with a message for every error."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from dpr_lab.errors import LinkUrlError

_LINKS = {
    re.compile("/dev/|COM[0-9]"): "serial://{}?baud=921600",
    re.compile("v?can[0-9]"): "can://socketcan/{}?bitrate=1000000",
}
"""Format of a link URL with the name of a port or an interface, by the pattern of the name."""


@dataclass(frozen=True, slots=True)
class LinkUrl:
    """A parsed link URL."""

    text: str
    """Text given by the operator."""
    scheme: str
    host: str
    """Part between `//` and the first slash, case-sensitive: `COM3`, `slcan`, `127.0.0.1:5555`."""
    path: str
    """Part from the first slash on; may be empty."""
    query: tuple[tuple[str, str], ...]

    def options(self, known: Mapping[str, Callable[[str], Any]]) -> dict[str, Any]:
        """Return the values of the options in the query, converted from text.

        Args:
            known: function for each option that converts its text, or raises ValueError("is not ...")

        Raises:
            LinkUrlError: an option is unknown, repeated or not valid.
        """
        parameters: dict[str, Any] = {}
        for name, text in self.query:
            if name not in known:
                names = ", ".join(known) or "none"
                raise LinkUrlError(f"{self.text}: unknown option {name!r} (options of this kind of link: {names})")
            if name in parameters:
                raise LinkUrlError(f"{self.text}: option {name!r} is given twice")
            try:
                parameters[name] = known[name](text)
            except ValueError as error:
                raise LinkUrlError(f"{self.text}: {name} = {text!r}: {error}") from error
        return parameters


def parse_url(text: str) -> LinkUrl:
    """Parse a link URL.

    Raises:
        LinkUrlError: the text is not of the form scheme://place?option=value.
    """
    try:
        split = urlsplit(text)
        query = tuple(parse_qsl(split.query, keep_blank_values=True, strict_parsing=bool(split.query)))
    except ValueError as error:
        raise LinkUrlError(f"{text}: is not a link URL ({error}); use scheme://place?option=value") from error
    if "://" not in text:
        link = next((link for kind, link in _LINKS.items() if kind.match(text)), "serial:///dev/ttyUSB0")
        raise LinkUrlError(
            f"{text or 'empty text'}: is not a link URL; use for example {link.format(text)}, or sim:// for a simulated"
            " device"
        )
    return LinkUrl(text, split.scheme, split.netloc, split.path, query)


def whole_number(text: str) -> int:
    """Parse a positive integer, such as a baud rate."""
    if not (text.isascii() and text.isdigit()) or int(text) == 0:
        raise ValueError("is not a positive whole number")
    return int(text)


def seconds(text: str) -> float:
    """Parse a time in s that is not negative."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise ValueError("is not a time in seconds")
    return value


def one_of(*choices: str) -> Callable[[str], str]:
    """Create a function that returns one of the given words unchanged and raises a ValueError for other texts."""

    def read(text: str) -> str:
        if text not in choices:
            raise ValueError(f"is not one of {', '.join(choices)}")
        return text

    return read
