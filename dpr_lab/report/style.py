"""Define the style of the figures.

Lines differ in width and dash as well as in colour, for screen and print.
"""

from contextlib import AbstractContextManager
from typing import Any

from matplotlib import style

WIDTH_IN = 9.0
"""Width of the figures, inch. Type of 9 pt is then 7 pt on a printed page, and 17 px at a width of 1200 px."""

DPI = 150

Style = dict[str, Any]
"""Properties of a line, an area or a text in Matplotlib."""

# Blues and orange of the palette of Okabe & Ito for colour-blind readers, and a vermillion that is darker in grey.
MEASURED: Style = {"color": "#56b4e9", "linewidth": 2.6, "linestyle": "-", "zorder": 2}
SIMULATED: Style = {"color": "#a63603", "linewidth": 1.1, "linestyle": (0, (4, 1.4)), "zorder": 3}
BEYOND: Style = {"color": "#a63603", "linewidth": 0.9, "linestyle": "-", "alpha": 0.5, "zorder": 3}
HORIZON: Style = {"color": "#222222", "linewidth": 1.2, "linestyle": ":", "zorder": 4}
RESIDUAL: Style = {"color": "#0072b2", "linewidth": 0.7, "linestyle": "-", "zorder": 2}
NOISE_BAND: Style = {
    # Drawn above the residual, so that its edges remain visible where dense noise fills the panel.
    "facecolor": ("#e69f00", 0.22),
    "edgecolor": "#222222",
    "linewidth": 0.9,
    "linestyle": (0, (5, 2)),
    "zorder": 3,
}
EVOLUTION: Style = {"color": "#0072b2", "linewidth": 1.5, "linestyle": "-"}
ZERO: Style = {"color": "#555555", "linewidth": 0.8}
NOTE_BOX: Style = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}

MODELS = {"before": ("bare model", SIMULATED), "after": ("corrected model", RESIDUAL)}
"""Label and line of each model."""

_SETTINGS: Style = {
    "figure.dpi": DPI,
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.edgecolor": "#555555",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "legend.handlelength": 3.2,
}


def house_style() -> AbstractContextManager[None]:
    """Return a context with the defaults of Matplotlib and the style of this module.

    The matplotlibrc of the user has no effect.
    """
    return style.context(["default", _SETTINGS])
