"""Parse keys, and the replies in which a terminal states its type."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from textual import events
from textual._xterm_parser import XTermParser
from textual.keys import Keys

from dpr_lab.tui.terminal.multiplexer import ATTRIBUTES, from_attributes, from_version

VERSION_BEGINS, VERSION_ENDS = "\x1bP>|", "\x1b\\"


@dataclass(frozen=True, slots=True)
class ReplySettings:
    """Format of replies of the terminal."""

    longest: int = 64
    """Maximum length of a version in a reply. Known replies have 8 to 30 characters."""


SETTINGS = ReplySettings()


class ReplyParser(XTermParser):
    """Parser of Textual, extended for replies that Textual would interpret as keys.

    Args:
        identified: called with the name of a multiplexer that replied
        debug: passed to the parser of Textual
    """

    def __init__(self, identified: Callable[[str], object], debug: bool = False) -> None:
        super().__init__(debug)
        self._identified = identified
        self._version: str | None = None

    def _sequence_to_key_events(self, sequence: str, alt: bool = False) -> Iterable[events.Key]:
        reply = self._in_reply(sequence)
        return [events.Key(Keys.Ignore, sequence)] if reply else super()._sequence_to_key_events(sequence, alt)

    def _in_reply(self, sequence: str) -> bool:
        """Return whether a sequence is a part of a reply about the type of the terminal.

        The parser of Textual calls this method for each prefix of an escape sequence.
        """
        if self._version is not None:
            return self._goes_on(sequence)
        if sequence == VERSION_BEGINS:
            self._version = ""
            return True
        if (attributes := ATTRIBUTES.fullmatch(sequence)) is None:
            return False
        self._tell(from_attributes(attributes[1]))
        return True

    def _goes_on(self, sequence: str) -> bool:
        assert self._version is not None
        if len(sequence) == 1 and sequence.isprintable() and len(self._version) < SETTINGS.longest:
            self._version += sequence
            return True
        version, self._version = self._version, None
        self._tell(from_version(version))
        return sequence == VERSION_ENDS

    def _tell(self, name: str) -> None:
        if name:
            self._identified(name)
