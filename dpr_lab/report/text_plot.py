"""Draw curves of braille characters for terminals without graphics."""

import numpy as np

from dpr_lab.arrays import Array

DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bit of each dot of a braille character, by row and column (Unicode 2800 to 28FF)."""


def text_chart(t: Array, y: Array, width: int = 64, height: int = 6) -> list[str]:
    """Draw a curve by `text_plot`, with its extreme values and a time axis.

    Args:
        t: (n,) increasing times, s
        y: (n,) angles, rad
        width: number of characters of the curve in a line
        height: number of lines of the curve

    Returns:
        the lines, top first; the last two are the time axis
    """
    high, low = (f"{value:.3g} rad" for value in (float(y.max()), float(y.min())))
    labels = [high, *[""] * (height - 2), low]
    margin = max(map(len, labels))
    lines = [f"{label:>{margin}} │{line}" for label, line in zip(labels, text_plot(t, y, width, height), strict=True)]
    first, last = f"{t[0]:.4g}", f"{t[-1]:.4g} s"
    left = " " * margin
    return [*lines, f"{left} └{'─' * width}", f"{left}  {first}{last:>{width - len(first)}}"]


def text_plot(t: Array, y: Array, width: int = 64, height: int = 6) -> list[str]:
    """Draw a curve as braille characters of 2 x 4 dots; extremes are kept.

    Args:
        t: (n,) increasing times, s
        y: (n,) values
        width: number of characters in a line
        height: number of lines

    Returns:
        the lines, top first
    """
    low, high = float(y.min()), float(y.max())
    rows = np.round((high - y) / ((high - low) or 1.0) * (4 * height - 1)).astype(int)
    columns = np.minimum(((t - t[0]) / ((t[-1] - t[0]) or 1.0) * 2 * width).astype(int), 2 * width - 1)
    cells = np.zeros((height, width), dtype=int)
    for column in range(2 * width):
        # Include the last sample of the previous column; a steep curve is then continuous.
        first, last = np.searchsorted(columns, [column, column + 1])
        if first == last:
            continue
        dots = rows[max(first - 1, 0) : last]
        for row in range(dots.min(), dots.max() + 1):
            cells[row // 4, column // 2] |= DOTS[row % 4][column % 2]
    return ["".join(chr(0x2800 + cell) for cell in line) for line in cells]
