"""Text can be read in every theme: contrast as the Web Content Accessibility Guidelines define it (WCAG 2.2, 1.4.3)."""

import pytest
from textual.color import Color
from textual.theme import Theme

from dpr_lab.tui.themes import THEMES

LEAST = {"dpr-dark": 4.5, "dpr-light": 4.5, "dpr-contrast": 7.0}
"""Minimum contrast: level AA and, for the high-contrast theme, AAA."""
TEXTS = ("foreground", "primary", "secondary", "accent", "success", "warning", "error")
GROUNDS = ("background", "surface", "panel")


def luminance(color: Color) -> float:
    """Relative luminance of an sRGB colour."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in color.normalized]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one: Color, other: Color) -> float:
    """Contrast ratio (L1 + 0.05) / (L2 + 0.05), with L1 the lighter colour."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_ratio_is_that_of_the_guidelines() -> None:
    white = Color.parse("#ffffff")
    assert contrast(white, Color.parse("#000000")) == pytest.approx(21.0)
    assert contrast(Color.parse("#777777"), white) == pytest.approx(
        4.48, abs=0.005
    )  # the known example that just fails


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
def test_every_text_can_be_read_on_every_background(theme: Theme, text: str, ground: str) -> None:
    colors = {name: Color.parse(getattr(theme, name)) for name in (text, ground)}
    assert contrast(colors[text], colors[ground]) >= LEAST[theme.name]
