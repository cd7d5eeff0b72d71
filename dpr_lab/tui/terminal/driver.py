"""Textual's driver for terminals: writes without waiting, asks what the terminal is, and ends within a bounded time."""

import os
import selectors
from codecs import getincrementaldecoder

from textual.drivers.linux_driver import LinuxDriver

from dpr_lab.tui.terminal.multiplexer import QUERY
from dpr_lab.tui.terminal.replies import ReplyParser
from dpr_lab.tui.terminal.writer import TerminalWriter

RESTORE = "\x1b[0m\x1b[?1000l\x1b[?1003l\x1b[?1015l\x1b[?1006l\x1b[?2004l\x1b[?1004l\x1b[?7h\x1b[<u\x1b[?1049l\x1b[?25h"
"""Mouse, paste and focus reports off, lines wrap, the ordinary screen and the cursor are back."""


class BenchDriver(LinuxDriver):
    """Writes through a `TerminalWriter`; a terminal that hangs up ends the app."""

    _out: TerminalWriter | None = None
    multiplexer = ""
    """Name of a multiplexer that answered for the terminal; empty as long as none did."""

    @property
    def idle(self) -> bool:
        """Whether the terminal has taken everything."""
        return self._out is None or self._out.idle

    def start_application_mode(self) -> None:
        """Start, and query the type of the terminal; it replies before it confirms the first frame."""
        super().start_application_mode()
        self.write(QUERY)

    def write(self, data: str) -> None:
        """Write soon."""
        if self._out is None:
            assert self._file is not None
            self._out = TerminalWriter(self._file.fileno())
        self._out.write(data)

    def close(self) -> None:
        """Restore the terminal, even if it does not accept the remaining output."""
        super().close()
        if self._out is not None:
            self._out.stop(RESTORE)

    def run_input_thread(self) -> None:
        """Wait for keys and replies until the end."""
        parser = ReplyParser(self._identified, self._debug)
        decode = getincrementaldecoder("utf-8")().decode
        with selectors.SelectSelector() as selector:
            selector.register(self.fileno, selectors.EVENT_READ)
            while not self.exit_event.is_set():
                if selector.select(0.1):
                    data = os.read(self.fileno, 4096)
                    if not data:
                        raise OSError("the terminal sends nothing any more")
                    text = decode(data)
                    for event in parser.feed(text) if text else ():
                        self.process_message(event)
                for event in parser.tick():
                    self.process_message(event)

    def _run_input_thread(self) -> None:
        try:
            self.run_input_thread()
        except OSError:  # the terminal hung up
            self._app.call_later(self._app.exit)

    def _identified(self, multiplexer: str) -> None:
        self.multiplexer = multiplexer
