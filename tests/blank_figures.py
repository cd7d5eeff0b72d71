"""A blank picture instead of a drawn figure: to draw the figures of a report takes as long as the diagnosis.

Commands that tests fork save blank pictures (`tests/loaded.py`). Tests of figures draw them in their own process, and
a command that a test starts as a new process, such as those of long pages of the documentation, draws its figures too.
"""

from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image


def save_blank(figure: Figure, path: Path) -> None:
    """As `dpr_lab.report.figures.save_png`, for a picture of one pixel."""
    Image.new("RGB", (1, 1)).save(path, format="PNG")
