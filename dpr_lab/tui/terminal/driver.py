"""Textual driver for terminals that never waits for a slow terminal.

It identifies the terminal, and ends within a limited time.
"""

import os
import selectors
from codecs import getincrementaldecoder

from textual.drivers.linux_driver import LinuxDriver

from dpr_lab.tui.terminal.multiplexer import QUERY
from dpr_lab.tui.terminal.replies import ReplyParser
from dpr_lab.tui.terminal.writer import TerminalWriter

RESTORE = "\x1b[0m\x1b[?1000l\x1b[?1003l\x1b[?1015l\x1b[?1006l\x1b[?2004l\x1b[?1004l\x1b[?7h\x1b[<u\x1b[?1049l\x1b[?25h"
"""Sequence that restores the terminal: mouse, paste and focus reports, line wrapping, screen and cursor."""


class BenchDriver(LinuxDriver):
    """Driver with a `TerminalWriter`; it ends the app if the terminal is closed."""

    _out: TerminalWriter | None = None
    multiplexer = ""
    """Name of a multiplexer that replied in place of the terminal; empty if none did."""

    @property
    def idle(self) -> bool:
        """Whether the terminal has received everything."""
        return self._out is None or self._out.idle

    def start_application_mode(self) -> None:
        """Start the screen and query the type of the terminal.

        The reply arrives before the first frame is confirmed.
        """
        super().start_application_mode()
        self.write(QUERY)

    def write(self, data: str) -> None:
        """Write without waiting."""
        if self._out is None:
            assert self._file is not None
            self._out = TerminalWriter(self._file.fileno())
        self._out.write(data)

    def close(self) -> None:
        """Restore the terminal, even if it no longer accepts output."""
        super().close()
        if self._out is not None:
            self._out.stop(RESTORE)

    def run_input_thread(self) -> None:
        """Read keys and replies until the end."""
        parser = ReplyParser(self._identified, self._debug)
        decode = getincrementaldecoder("utf-8")().decode
        with selectors.SelectSelector() as selector:
            selector.register(self.fileno, selectors.EVENT_READ)
            while not self.exit_event.is_set():
                if selector.select(0.1):
                    data = os.read(self.fileno, 4096)
                    if not data:
                        raise OSError("the terminal no longer sends anything")
                    text = decode(data)
                    for event in parser.feed(text) if text else ():
                        self.process_message(event)
                for event in parser.tick():
                    self.process_message(event)

    def _run_input_thread(self) -> None:
        try:
            self.run_input_thread()
        except OSError:  # the terminal was closed
            self._app.call_later(self._app.exit)

    def _identified(self, multiplexer: str) -> None:
        self.multiplexer = multiplexer
