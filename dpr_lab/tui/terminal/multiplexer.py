"""Detect programs that keep a session and answer cursor queries for the operator's terminal.

tmux, GNU screen, Zellij and mosh are terminals themselves. They confirm a frame at once, even if no operator is
attached.
"""

import re
from collections.abc import Mapping

IN_ENVIRONMENT = {"TMUX": "tmux", "STY": "GNU screen", "ZELLIJ": "Zellij"}
"""Name of the multiplexer that sets each environment variable."""
IN_TERM = {"tmux": "tmux", "screen": "GNU screen or tmux"}
"""Name of the multiplexer for each prefix of the variable TERM. Unlike the other variables, ssh passes TERM on to the
remote computer."""
IN_ATTRIBUTES = {"83": "GNU screen", "84": "tmux", "1;10;0": "mosh"}
"""Name of the multiplexer for each reply to `ESC [ > c` (secondary device attributes, DEC).

A key is the terminal type, which is the first number of the reply, or the whole reply.

Sources: ansi.c of GNU screen (83 is the code of S), input.c of tmux (84 is the code of T), terminalfunctions.cc of
mosh.
"""
IN_VERSION = ("tmux", "screen", "zellij")
"""Texts in the reply to `ESC [ > q` (XTVERSION, xterm)."""

QUERY = "\x1b[>c\x1b[>q"
"""Queries for the attributes and the version of the terminal."""
ATTRIBUTES = re.compile(r"\x1b\[>([\d;]*)c")


def from_environment(environment: Mapping[str, str]) -> str:
    """Return the name of the multiplexer according to environment variables.

    The text is empty if they name no multiplexer.
    """
    for variable, name in IN_ENVIRONMENT.items():
        if environment.get(variable):
            return name
    return next((name for start, name in IN_TERM.items() if environment.get("TERM", "").startswith(start)), "")


def from_attributes(reply: str) -> str:
    """Return the name of the multiplexer that reports these device attributes, such as `84;0;0`.

    The text is empty if a terminal reports these attributes.
    """
    return IN_ATTRIBUTES.get(reply) or IN_ATTRIBUTES.get(reply.partition(";")[0], "")


def from_version(reply: str) -> str:
    """Return the name of the multiplexer that reports this version, such as `tmux 3.4`.

    The text is empty if a terminal reports this version.
    """
    return reply if any(word in reply.lower() for word in IN_VERSION) else ""
