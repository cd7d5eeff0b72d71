"""Permissions of a read-only page: the screen in a browser without `--allow-release`.

Each action, screen or job that is not in one of the lists of this module is refused.
"""

import errno
import os
import sys
from collections.abc import Callable
from typing import Any

from dpr_lab.errors import SafetyStop

READ_ONLY = (
    "This page is read-only: it sends nothing to the device and writes no file. Use the screen at the rig,"
    " or start with"
    " dpr-lab tui --serve PORT --allow-release"
)

ACTIONS = frozenset(
    (
        "accept",
        "answer",
        "browse",
        "choose",
        "choose_all",
        "cursor",
        "cursors",
        "cycle",
        "filter",
        "go",
        "help",
        "leave",
        "length",
        "look",
        "messages",
        "move",
        "next_theme",
        "next_unit",
        "other",
        "page",
        "pan",
        "quit",
        "read",
        "verify",
        "view",
        "whole",
        "zoom",
        "zoom_y",
    )
)
"""Actions of dpr-lab that change nothing but the display. Actions of Textual's own widgets, which move a cursor or edit
a text, are also permitted."""

SCREENS = frozenset(("CommandPalette", "HelpScreen", "MessageScreen", "Question", "RunBrowser"))
"""Names of the screens that may open above a step because they change nothing."""

JOBS = frozenset(("survey", "verify"))
"""Names of the job functions that only read run files."""


def changes(owner: object, action: str) -> bool:
    """Return whether an action of dpr-lab may change more than the display."""
    method = getattr(owner, f"action_{action}", None)
    return method is not None and str(method.__module__).startswith("dpr_lab.") and action not in ACTIONS


def refuse_job(read_only: bool, function: Callable[..., Any]) -> None:
    """Refuse a job that does more than read.

    Raises:
        SafetyStop: the page is read-only and the job is not in `JOBS`.
    """
    if read_only and function.__name__ not in JOBS:
        raise SafetyStop(READ_ONLY)


_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_CHANGES = frozenset(
    (
        "os.mkdir",
        "os.rename",
        "os.remove",
        "os.rmdir",
        "os.link",
        "os.symlink",
        "os.truncate",
        "os.chmod",
        "os.chown",
        "os.utime",
        "os.system",
        "subprocess.Popen",
        "os.posix_spawn",
        "os.exec",
    )
)


def forbid_writing() -> None:
    """Forbid this process to write files, change folders or start programs.

    Actions that are not permitted are already refused with a message. This function is a second protection, in case a
    list of permitted actions contains one that writes. Its effect cannot be undone.
    """
    sys.dont_write_bytecode = True
    sys.addaudithook(_refuse_writing)


def _refuse_writing(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open":
        path, _, flags = arguments
        if isinstance(path, int) or not (flags or 0) & _WRITING or str(path).startswith("/dev/"):
            return
    elif event not in _CHANGES:
        return
    raise PermissionError(errno.EACCES, READ_ONLY)
