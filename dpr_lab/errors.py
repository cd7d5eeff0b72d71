"""Exceptions for problems that the operator can resolve.

    DprError               base; the message says what happened, where, and what to do
    +-- ConfigError        a rig, search or plant file is not valid; the message names file, key, value and range
    +-- LinkError          a port or bus cannot be opened, is busy or was lost; the message names the URL
    |   +-- LinkUrlError   the URL is not valid
    |   +-- LinkTimeout    the link opened, but the device did not answer
    |   +-- DeviceLost     the device stopped answering (for example, cable pulled or power lost)
    |   +-- LeaseLost      the device stopped streaming, because it received no messages of the host
    +-- MismatchError      the device uses another protocol version or schema
    +-- DeviceFault        the device refused a command or reported a fault
    +-- SafetyStop         a check before the release did not pass, so the release was refused
    +-- OutputError        a result cannot be written
    +-- RunError           a recording cannot be read or does not match the rig
    +-- IdentificationError  the identification ran but failed its own checks
    +-- UnexpectedError    a plugin failed; a bug of dpr-lab has the same exit code

Each class defines the exit code of `dpr-lab`. Other failures are reported in other ways. An invalid argument raises a
`ValueError`, a candidate of a search that cannot be simulated has the cost `inf`, and a bug violates an `assert`.
"""

import difflib
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Pattern of characters that move a terminal's cursor or change the direction of text, and of code points without a
character."""


def printable(text: str) -> str:
    """Escape control characters in text from a file, a device or a file name."""
    return _CONTROL.sub(lambda control: control[0].encode("unicode_escape").decode(), text)


def all_printable(value: Any) -> Any:
    """Make all texts in the content of a JSON file safe for display."""
    if isinstance(value, dict):
        return {printable(key): all_printable(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [all_printable(entry) for entry in value]
    return printable(value) if isinstance(value, str) else value


def known_name(name: str, known: Iterable[str], worded: Callable[[str], str] = str) -> str | None:
    """Find the known name to which a text refers, or None.

    The text may be the name, its description, or both in the form `description [name]`.

    Args:
        name: the text
        known: the existing identifiers
        worded: function that returns the description of an identifier
    """
    words_of_text, names = " ".join(name.lower().split()), list(known)
    for candidate in names:
        words = worded(candidate).lower()
        if words_of_text in (candidate.lower(), words, words.removesuffix(f" [{candidate.lower()}]")):
            return candidate
    return None


def refuse_unknown(names: Iterable[str], known: Collection[str], kind: str) -> None:
    """Check that all names of a kind are known.

    Raises:
        ConfigError: a name is unknown; the message lists known names.
    """
    for name in names:
        if name not in known:
            raise ConfigError(unknown_name(f"no {kind} named {name}", name, known))


def unknown_name(
    problem: str,
    name: str,
    known: Iterable[str],
    worded: Callable[[str], str] = str,
    few: int = 8,
    nearest: int = 5,
) -> str:
    """Compose the error message for an unknown name.

    The message lists all known names if there are few of them, otherwise the most similar names.

    Args:
        problem: the error, for example `no effect named dust`
        name: the given name
        known: the existing names
        worded: function that returns the description of a known name
        few: maximum number of known names for which all names are listed
        nearest: number of most similar names that are listed if there are more than `few` known names
    """
    names = list(known)
    shown = [worded(identifier) for identifier in names]
    if not names:
        return f"{problem}; there are none"
    between = "; " if any("," in words for words in shown) else ", "
    if len(names) <= few:
        return f"{problem}; available: {between.join(shown)}"
    pairs = zip(names, shown, strict=True)
    ranked = sorted(pairs, key=lambda pair: _similarity(name, *pair), reverse=True)
    return f"{problem}; nearest of {len(names)}: {between.join(words for _, words in ranked[:nearest])}"


def _similarity(name: str, known: str, words: str) -> float:
    """Return the similarity of a text to a name or its description, 0 to 1.

    The similarity is 1 if the name or its description starts with the text.
    """
    name = name.lower().strip()
    texts = known.lower(), words.lower().removesuffix(f" [{known.lower()}]")
    if name and any(text.startswith(name) for text in texts):
        return 1.0
    return max(difflib.SequenceMatcher(None, name, text).ratio() for text in texts)


class DprError(Exception):
    """Base class of errors that an operator can resolve."""

    exit_code = 1

    def __str__(self) -> str:
        return printable(super().__str__())


class ConfigError(DprError):
    """Raised if a configuration file is missing, malformed, or contains a wrong value."""

    exit_code = 3
    keys: Sequence[str] = ()
    """For each line of the message, the key to which it refers; empty if several keys contradict each other."""


class LinkError(DprError):
    """Raised if a port or bus cannot be opened or used."""

    exit_code = 4


class LinkUrlError(LinkError):
    """Raised if a link URL is not valid.

    The URL has an unknown kind, option or port, or a wrong value.
    """

    exit_code = 2


class LinkTimeout(LinkError):
    """Raised if the link was opened, but the device did not answer in time."""


class DeviceLost(LinkError):
    """Raised if the device stopped answering; recorded samples are kept."""

    exit_code = 7


class LeaseLost(LinkError):
    """Raised if the device stopped streaming, because it received no messages of the host in time."""


class MismatchError(DprError):
    """Raised if the device uses another version of the protocol than this program."""

    exit_code = 5


class DeviceFault(DprError):
    """Raised if the device refused a command or is in its fault state."""

    exit_code = 4


class SafetyStop(DprError):
    """Raised if a check before the release failed; the rods remain held."""


class OutputError(DprError):
    """Raised if a result cannot be written."""

    exit_code = 3


class RunError(DprError):
    """Raised if a recording cannot be read, is damaged, or belongs to another rig."""

    exit_code = 3


class IdentificationError(DprError):
    """Raised if an identification ran, but its result failed a check."""

    exit_code = 8


class UnexpectedError(DprError):
    """Raised if a plugin failed.

    Its exit code is EX_SOFTWARE of sysexits.h, as for a bug of this program. It differs from 1, the code of a test that
    did not pass.
    """

    exit_code = 70
