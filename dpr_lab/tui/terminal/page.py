"""Textual driver for a browser that ends the screen together with its server."""

import os
import signal
import threading
from contextlib import suppress

from textual.drivers.web_driver import WebDriver

from dpr_lab.tui.terminal.signals import ENDING


class PageDriver(WebDriver):
    """Driver that ends the screen when its server has ended, and discards the remaining output.

    A killed server cannot end its screens, but its side of the pipes is closed: input ends, and output fails.
    """

    def write(self, data: str) -> None:
        """Send the output if the server still exists."""
        with suppress(OSError):
            super().write(data)

    def write_meta(self, data: dict[str, object]) -> None:
        """Send messages other than the output, if the server still exists."""
        with suppress(OSError):
            super().write_meta(data)

    def run_input_thread(self) -> None:
        """Read the input.

        When the input ends, the screen is ended. After a time limit the process is terminated.
        """
        super().run_input_thread()
        if not self.exit_event.is_set():
            watch = threading.Timer(ENDING.patience_s, os._exit, (ENDING.exit_code,))
            watch.daemon = True
            watch.start()
            os.kill(os.getpid(), signal.SIGTERM)
