"""Importing this draws the figures of reports small and without a layout, where tests do not look at them.

To arrange and draw the figures of one diagnosis takes longer than the diagnosis. `tests/report` draws them as they are,
and so does every command that a test starts as a process of its own.
"""

from pathlib import Path

from matplotlib.figure import Figure

from dpr_lab.report import figures

DPI = 30
_save = figures._save  # pyright: ignore[reportPrivateUsage]


def save(figure: Figure, path: Path) -> None:
    """As `dpr_lab.report.figures._save`, for a small picture whose parts may overlap."""
    figure.set_layout_engine("none")
    figure.set_dpi(DPI)
    _save(figure, path)


figures._save = save  # pyright: ignore[reportPrivateUsage]
