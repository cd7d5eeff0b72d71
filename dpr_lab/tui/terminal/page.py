"""Driver of a screen in a browser: that of Textual, extended such that the screen ends with its server."""

import os
import signal
import threading
from contextlib import suppress

from textual.drivers.web_driver import WebDriver

from dpr_lab.tui.terminal.signals import ENDING


class PageDriver(WebDriver):
    """Driver that ends the screen when the server ends, and discards the remaining output.

    A server that was killed cannot end its screens, but its side of the pipes is closed: input ends, output fails.
    """

    def write(self, data: str) -> None:
        """Send the output if the server still exists."""
        with suppress(OSError):
            super().write(data)

    def write_meta(self, data: dict[str, object]) -> None:
        """Send data other than the output."""
        with suppress(OSError):
            super().write_meta(data)

    def run_input_thread(self) -> None:
        """Read the input; its end ends the screen, or terminates it if this takes too long."""
        super().run_input_thread()
        if not self.exit_event.is_set():
            watch = threading.Timer(ENDING.patience_s, os._exit, (ENDING.exit_code,))
            watch.daemon = True
            watch.start()
            os.kill(os.getpid(), signal.SIGTERM)
