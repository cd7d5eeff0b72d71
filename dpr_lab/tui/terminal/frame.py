"""Requested and transmitted content of the cells of a terminal; the output is the difference."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.cells import get_character_cell_size
from rich.color import ColorSystem
from rich.style import Style
from textual._compositor import ChopsUpdate, CompositorUpdate, LayoutUpdate
from textual.strip import Strip

ATTRIBUTES = {"bold": "1", "dim": "2", "italic": "3", "underline": "4", "blink": "5", "reverse": "7", "strike": "9"}
"""SGR parameter (ECMA-48) of each attribute of a Rich style."""


@dataclass(frozen=True, slots=True)
class Look:
    """Style of a character as SGR parameters, which are empty for the default style."""

    attributes: str = ""
    colour: str = ""
    ground: str = ""

    def after(self, before: "Look | None") -> str:
        """Return the control sequence that changes from the style `before` to this style.

        None stands for an unknown style.
        """
        if before is None or before.attributes != self.attributes:
            parts = [part for part in ("0", self.attributes, self.colour, self.ground) if part]
        else:
            parts = [self.colour or "39"] if self.colour != before.colour else []
            parts += [self.ground or "49"] if self.ground != before.ground else []
        return f"\x1b[{';'.join(parts)}m" if parts else ""


@dataclass(frozen=True, slots=True)
class FrameSettings:
    """Costs of terminal output."""

    bridge: int = 4
    """Maximum number of unchanged cells between two changed cells for which the unchanged cells are sent again. This
    output is shorter than a cursor movement."""
    looks: int = 4096
    """Maximum number of cached styles. A screen has some dozen."""


SETTINGS = FrameSettings()
Cell = tuple[str, Look]
BLANK: Cell = (" ", Look())
UNKNOWN: Cell = ("", Look("?"))
"""Content that differs from every possible content of a cell."""


class CellFrame:
    """Requested and transmitted content of all cells of a terminal.

    Args:
        width: columns
        height: rows
        colours: colours of the terminal; None: no colours
    """

    def __init__(self, width: int, height: int, colours: ColorSystem | None) -> None:
        self.width, self.height = width, height
        self._colours = colours
        self._wanted = [[BLANK] * width for _ in range(height)]
        self._sent: list[list[Cell]] = []
        self._looks: dict[tuple[object, ...], Look] = {}
        self.forget()

    def forget(self) -> None:
        """Treat all cells as changed, because the content of the terminal is unknown."""
        self._sent = [[UNKNOWN] * self.width for _ in range(self.height)]

    @property
    def changed(self) -> bool:
        """Whether the requested content differs from the transmitted content."""
        return self._wanted != self._sent

    def paint(self, update: CompositorUpdate) -> None:
        """Update the requested content with the output of Textual."""
        if isinstance(update, LayoutUpdate):
            for y, strips in enumerate(update.strips, update.region.y):
                x = update.region.x
                for strip in strips:
                    x = self._put(x, y, strip)
        elif isinstance(update, ChopsUpdate):
            for y, begin, end in update.spans:
                for x, strip in update.chops[y].items():
                    if strip is not None and x < end and x + strip.cell_length > begin:
                        self._put(max(x, begin), y, strip.crop(max(begin - x, 0), end - x))

    def changes(self) -> str:
        """Return the output that changes the terminal to the requested content.

        The requested content is then recorded as transmitted.
        """
        out: list[str] = []
        pen: Look | None = None
        for y, (wanted, sent) in enumerate(zip(self._wanted, self._sent, strict=True)):
            column = 0
            for first, last in _runs(wanted, sent):
                out.append(f"\x1b[{first - column}C" if 0 < column <= first else f"\x1b[{y + 1};{first + 1}H")
                for text, look in wanted[first:last]:
                    if look != pen:
                        out.append(look.after(pen))
                        pen = look
                    out.append(text)
                column = last
            sent[:] = wanted
        return "".join(out)

    def _put(self, x: int, y: int, strip: Strip) -> int:
        """Write a strip of text from a cell on, and return the column after its end."""
        row = self._wanted[y] if 0 <= y < self.height else None
        for segment in strip:
            if segment.control:
                continue
            look = self._look(segment.style or Style.null())
            for character in segment.text:
                wide = 1 if character.isascii() else get_character_cell_size(character)
                if row is not None and 0 <= x <= self.width - wide:
                    self._set(row, x, character if character.isprintable() else "·", look, wide)
                x += wide
        return x

    @staticmethod
    def _set(row: list[Cell], x: int, character: str, look: Look, wide: int) -> None:
        if wide == 0:
            if x > 0:
                row[x - 1] = (row[x - 1][0] + character, row[x - 1][1])
            return
        row[x] = (character, look)
        if wide == 2:
            row[x + 1] = ("", look)

    def _look(self, style: Style) -> Look:
        names = tuple(name for name in ATTRIBUTES if getattr(style, name))
        key = (style.color, style.bgcolor, names)
        if (look := self._looks.get(key)) is None:
            if len(self._looks) >= SETTINGS.looks:
                self._looks.clear()
            look = self._looks[key] = Look(";".join(ATTRIBUTES[n] for n in names), *self._sgr(style))
        return look

    def _sgr(self, style: Style) -> tuple[str, str]:
        if self._colours is None:
            return "", ""
        colour, ground = (
            ";".join(part.downgrade(self._colours).get_ansi_codes(foreground)) if part is not None else ""
            for part, foreground in ((style.color, True), (style.bgcolor, False))
        )
        return colour, ground


def _runs(wanted: Sequence[Cell], sent: Sequence[Cell]) -> Iterator[tuple[int, int]]:
    """Yield the first cell and the end (exclusive) of each section of a row that must be sent.

    A section contains unchanged cells if their output is shorter than a cursor movement.
    """
    if wanted == sent:
        return
    first = last = -1
    for x, (new, old) in enumerate(zip(wanted, sent, strict=True)):
        if new == old:
            continue
        if first < 0:
            first = x
        elif x - last > SETTINGS.bridge:
            yield first, last
            first = x
        last = x + 1
    while first > 0 and wanted[first][0] == "":  # the second half of a wide character
        first -= 1
    yield first, last
