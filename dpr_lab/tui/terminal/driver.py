"""Textual's driver for terminals, with a writer that never blocks the screen and an end within a bounded time."""

from textual.drivers.linux_driver import LinuxDriver

from dpr_lab.tui.terminal.writer import TerminalWriter

RESTORE = "\x1b[0m\x1b[?1000l\x1b[?1003l\x1b[?1015l\x1b[?1006l\x1b[?2004l\x1b[?1004l\x1b[?7h\x1b[<u\x1b[?1049l\x1b[?25h"
"""Mouse, paste and focus reports off, lines wrap, the ordinary screen and the cursor are back."""


class BenchDriver(LinuxDriver):
    """Writes through a `TerminalWriter`; a terminal that hangs up ends the app."""

    _out: TerminalWriter | None = None

    @property
    def idle(self) -> bool:
        """Whether the terminal has taken everything."""
        return self._out is None or self._out.idle

    def write(self, data: str) -> None:
        """Write soon."""
        if self._out is None:
            assert self._file is not None
            self._out = TerminalWriter(self._file.fileno())
        self._out.write(data)

    def close(self) -> None:
        """Restore the terminal, whether it takes what is left or not."""
        super().close()
        if self._out is not None:
            self._out.stop(RESTORE)

    def _run_input_thread(self) -> None:
        try:
            self.run_input_thread()
        except OSError:  # the terminal hung up
            self._app.call_later(self._app.exit)
