"""A curve in characters, for where nothing else can be drawn."""

import numpy as np
from numpy.typing import NDArray

DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bit of each dot of a braille character, by row and column (Unicode 2800 to 28FF)."""


def text_chart(
    t: NDArray[np.float64], y: NDArray[np.float64], unit: str = "rad", width: int = 64, height: int = 6
) -> list[str]:
    """A curve as `text_plot` draws it, with its largest and smallest value on the left and time below.

    Args:
        t: (n,) increasing instants, s
        y: (n,) values, in `unit`
        unit: of the values
        width: characters of the curve in a line
        height: lines of the curve

    Returns:
        the lines, top first; the last two are the time axis
    """
    high, low = (f"{value:.3g} {unit}" for value in (float(y.max()), float(y.min())))
    names = [high, *[""] * (height - 2), low]
    margin = max(map(len, names))
    drawn = [f"{name:>{margin}} │{line}" for name, line in zip(names, text_plot(t, y, width, height), strict=True)]
    begin, end = f"{t[0]:.4g}", f"{t[-1]:.4g} s"
    left = " " * margin
    return [*drawn, f"{left} └{'─' * width}", f"{left}  {begin}{end:>{width - len(begin)}}"]


def text_plot(t: NDArray[np.float64], y: NDArray[np.float64], width: int = 64, height: int = 6) -> list[str]:
    """A curve as lines of braille characters, two dots wide and four high each; extremes are kept.

    Args:
        t: (n,) increasing instants, s
        y: (n,) values
        width: characters in a line
        height: lines

    Returns:
        the lines, top first
    """
    low, high = float(y.min()), float(y.max())
    rows = np.round((high - y) / ((high - low) or 1.0) * (4 * height - 1)).astype(int)
    columns = np.minimum(((t - t[0]) / ((t[-1] - t[0]) or 1.0) * 2 * width).astype(int), 2 * width - 1)
    cells = np.zeros((height, width), dtype=int)
    for column in range(2 * width):
        # From the sample before the column to its last one, so that a steep curve has no holes.
        begin, end = np.searchsorted(columns, [column, column + 1])
        if begin == end:
            continue
        drawn = rows[max(begin - 1, 0) : end]
        for row in range(drawn.min(), drawn.max() + 1):
            cells[row // 4, column // 2] |= DOTS[row % 4][column % 2]
    return ["".join(chr(0x2800 + cell) for cell in line) for line in cells]
