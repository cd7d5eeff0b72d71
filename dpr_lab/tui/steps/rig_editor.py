"""Editor for a rig file; the text is checked before it is saved."""

from pathlib import Path

from textual.app import ComposeResult
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static, TextArea

from dpr_lab.configs import BUILTIN
from dpr_lab.errors import ConfigError
from dpr_lab.rig import parse_rig
from dpr_lab.tui.guard import Guarded
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.path_suggester import PathSuggester
from dpr_lab.tui.widgets.dialogs import confirm
from dpr_lab.tui.widgets.key_line import KeyLine
from dpr_lab.whole_file import write_text


class RigEditor(Guarded, ModalScreen[Path | None]):
    """Editor of a rig file; it returns the path of the saved file.

    Args:
        source: initial rig file
    """

    BINDINGS = bindings("editor")
    DEFAULT_CSS = """
    RigEditor { align: center middle; }
    RigEditor > Vertical { width: 100%; height: 100%; background: $surface; border: round $primary; padding: 0 1; }
    RigEditor TextArea { height: 1fr; border: none; }
    RigEditor Input { height: 1; }
    RigEditor #verdict { height: auto; max-height: 4; text-style: bold; }
    """

    def __init__(self, source: Path) -> None:
        super().__init__()
        self._source = source
        self._text = source.read_text(encoding="utf-8")

    def compose(self) -> ComposeResult:
        """Build the fields for path and text, and the list of errors."""
        editable = self._source.parent != BUILTIN / "rigs"
        with Vertical() as page:
            page.border_title = "Rig file"
            target = str(self._source if editable else Path.cwd() / f"my_{self._source.name}")
            yield Input(target, id="target", suggester=PathSuggester(".toml"), compact=True)
            yield TextArea(self._text, show_line_numbers=True)
            yield Static(id="verdict", markup=False)
            yield KeyLine()

    def on_mount(self) -> None:
        """Focus the text."""
        self.query_one(TextArea).focus()

    def action_leave(self) -> None:
        """Close the editor; ask for confirmation if changes would be lost."""
        if self.query_one(TextArea).text == self._text:
            self.dismiss(None)
        else:
            confirm(self.app, "Close and discard the changes?", "Leave", "Stay", self._discard)

    def _discard(self) -> None:
        self.dismiss(None)  # not returned: Textual would await it, and a screen cannot await its own end

    def action_save(self) -> None:
        """Check the text, and write it atomically."""
        text, target = self.query_one(TextArea).text, Path(self.query_one(Input).value.strip()).expanduser()
        try:
            parse_rig(text)
            _write(target, text)
        except ConfigError as error:
            self.query_one("#verdict", Static).update(f"not saved: {error}")
        else:
            self.dismiss(target.resolve())


def _write(target: Path, text: str) -> None:
    if target.suffix != ".toml":
        raise ConfigError(f"{target}: give the file a name that ends in .toml")
    if target.resolve().parent == BUILTIN.resolve() / "rigs":
        raise ConfigError(f"{target}: this rig file is built in: save your rig under another name")
    write_text(target, text, ConfigError)
