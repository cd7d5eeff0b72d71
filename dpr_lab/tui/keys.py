"""Key bindings of the screen.

`keys.toml` contains the defaults, and `app.py` the keys of the steps. A file of the operator can replace both.

Example of such a file:

[capture]
release = "space"

[app]
next = "n,ctrl+right"
"""

import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import platformdirs
from textual.binding import Binding, BindingType
from textual.dom import DOMNode
from textual.keys import Keys

from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import regular

MODIFIERS = ("ctrl", "shift", "alt", "super", "meta", "hyper")

Keymap = dict[str, str]
"""Mapping of action identifiers to keys, separated by commas."""

MENTION = re.compile(r"\{([a-z]+\.[a-z_0-9]+)\}")
"""Pattern of a placeholder for the key of an action in a text: `press {capture.start}`."""

REMOVED = re.compile(r"slider\.[a-z]+|[a-z]+\.pause|compare\.(earlier|later)")
"""Pattern of the actions of version 0.2 that no longer exist. Their keys in the operator's file are ignored."""


_DEFAULTS: dict[str, dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_name("keys.toml").read_text(encoding="utf-8")
)


@dataclass(frozen=True, slots=True)
class KeyNames:
    """Names of the current keys, for texts that mention keys."""

    keys: Mapping[str, str]
    """Mapping of action identifiers to keys."""
    display: Callable[[str], str]
    """Function that converts a key to its displayed name."""

    def key_for(self, action: str) -> str:
        """Return the first key of an action.

        Raises:
            KeyError: unknown action.
        """
        return self.display(self.keys[action].split(",")[0].strip())

    def fill(self, text: str) -> str:
        """Replace the placeholders of actions by their keys; other braces are not changed."""
        return MENTION.sub(lambda mention: self.key_for(mention[1]) if mention[1] in self.keys else mention[0], text)


def bindings(section: str) -> list[BindingType]:
    """Return the default keys of a section of `keys.toml`."""
    rows = _DEFAULTS[section].items()
    return [Binding(**(dict[str, Any](id=f"{section}.{name}", action=name) | row)) for name, row in rows]


def keys_file() -> Path:
    """Return the path of the operator's key bindings.

    The folder is DPR_LAB_CONFIG or, if it is not set, that of the user.
    """
    return Path(os.environ.get("DPR_LAB_CONFIG") or platformdirs.user_config_dir("dpr-lab")) / "keys.toml"


def about_keys() -> str:
    """Return the help text that explains how to change keys."""
    return f"""
**Your own keys** are defined in `{keys_file()}`: a section for each page, with actions and their keys, such as

    [capture]
    release = "space"

The sections are `app`, `chart`, `runs` and the names of the steps. A file with an unknown action or key, or with the
same key for two actions that are available at the same time, is rejected. The message about an unknown action lists all
actions.
"""


def load_keymap(path: Path, everywhere: type[DOMNode], places: Iterable[type[DOMNode]]) -> Keymap:
    """Read the operator's key bindings.

    Args:
        path: the file; the default keys apply if it does not exist
        everywhere: class whose actions are available everywhere: the app
        places: classes whose actions are available only while they are shown, such as steps and charts

    Raises:
        ConfigError: the file is not TOML, or contains an unknown action, an unknown key, or one key for two actions
            that are available at the same time.
    """
    try:
        table = tomllib.loads(regular(path, ConfigError).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{path}: cannot be used: {error}") from error
    keymap = {name: keys for name, keys in _flat(path, table) if not REMOVED.fullmatch(name)}
    common, local = actions(everywhere), [actions(place) for place in places]
    known = common | {name: keys for place in local for name, keys in place.items()}
    for name, keys in keymap.items():
        if name not in known:
            raise ConfigError(f"{path}: {name}: unknown action (known actions: {', '.join(sorted(known))})")
        for key in keys.split(","):
            _check_key(path, name, key)
    for defaults in local or [{}]:
        _check_clashes(path, keymap, common | defaults)
    return keymap


def actions(*owners: type[DOMNode]) -> dict[str, str]:
    """Return the ids and default keys of the actions of the given classes."""
    defaults = (binding for owner in owners for binding in owner.__dict__.get("BINDINGS", ()))
    return {binding.id: binding.key for binding in defaults if isinstance(binding, Binding) and binding.id}


def _flat(path: Path, table: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    for place, keys in table.items():
        if not isinstance(keys, dict):
            raise ConfigError(f"{path}: {place}: write the actions below the name of their section, such as [capture]")
        for action, key in keys.items():
            name = f"{place}.{action}"
            if not isinstance(key, str) or not key.strip():
                raise ConfigError(f'{path}: {name} = {key!r}: give a key such as "r" or "ctrl+r"')
            yield name, ",".join(part.strip() for part in key.split(","))


def _check_key(path: Path, name: str, key: str) -> None:
    *modifiers, base = key.split("+") if key != "+" else [key]
    if len(base) == 1 or base in {known.value for known in Keys}:
        if all(modifier in MODIFIERS for modifier in modifiers):
            return
    raise ConfigError(f"{path}: {name} = {key!r}: unknown key: use for example r, space, f5 or ctrl+r")


def _check_clashes(path: Path, keymap: Keymap, defaults: Mapping[str, str]) -> None:
    taken: dict[str, str] = {}
    for name in defaults:
        for key in _spelled_out(keymap.get(name, defaults[name])):
            other = taken.setdefault(key, name)
            if other != name and (name in keymap or other in keymap):
                raise ConfigError(
                    f"{path}: the key {key!r} is assigned to both {other} and {name}: give one of them another key"
                )


def _spelled_out(keys: str) -> list[str]:
    """Return the names of keys as Textual writes them, for example `question_mark` for `?`."""
    return [binding.key for binding in Binding.make_bindings([Binding(keys, "compare")])]
