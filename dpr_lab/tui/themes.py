"""Themes: dark, light, and high contrast."""

from textual.theme import Theme

DARK = Theme(
    name="dpr-dark",
    primary="#5fafff",
    secondary="#ffaf5f",
    accent="#d787ff",
    success="#5fd787",
    warning="#ffd75f",
    error="#ff6f6f",
    foreground="#e4e4e4",
    background="#121212",
    surface="#1c1c1c",
    panel="#262626",
    dark=True,
)
LIGHT = Theme(
    name="dpr-light",
    primary="#005fa8",
    secondary="#9c4c00",
    accent="#7a2a9c",
    success="#146c2e",
    warning="#8a5a00",
    error="#b3001b",
    foreground="#1a1a1a",
    background="#ffffff",
    surface="#f4f4f4",
    panel="#e6e6e6",
    dark=False,
)
CONTRAST = Theme(
    name="dpr-contrast",
    primary="#00ffff",
    secondary="#ffff00",
    accent="#ff80ff",
    success="#00ff00",
    warning="#ffff00",
    error="#ff8080",
    foreground="#ffffff",
    background="#000000",
    surface="#000000",
    panel="#000000",
    text_alpha=1.0,
    dark=True,
)
THEMES = (DARK, LIGHT, CONTRAST)
"""Themes in the order in which a key switches between them."""
