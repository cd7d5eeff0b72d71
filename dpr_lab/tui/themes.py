"""Themes: dark, light, and high contrast."""

import tomllib
from pathlib import Path

from textual.theme import Theme

THEMES = tuple(
    Theme(name, **colours)
    for name, colours in tomllib.loads(Path(__file__).with_name("themes.toml").read_text(encoding="utf-8")).items()
)
"""Themes in the order in which a key switches between them."""
