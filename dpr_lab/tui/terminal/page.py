"""The driver of a screen in a browser: Textual's, and the screen ends with the server that it writes to."""

import os
import signal
import threading
from contextlib import suppress

from textual.drivers.web_driver import WebDriver

from dpr_lab.tui.terminal.signals import SETTINGS


class PageDriver(WebDriver):
    """Driver that ends the screen when the server is gone and drops the remaining output.

    A server that was killed cannot end its screens. Its end of the pipes is closed then: input ends, output fails.
    """

    def write(self, data: str) -> None:
        """Send what is drawn, while there is somebody to send it to."""
        with suppress(OSError):
            super().write(data)

    def write_meta(self, data: dict[str, object]) -> None:
        """Send something else than what is drawn."""
        with suppress(OSError):
            super().write_meta(data)

    def run_input_thread(self) -> None:
        """Read what is typed; its end ends the screen in good order, or at once where that takes too long."""
        super().run_input_thread()
        if not self.exit_event.is_set():
            watch = threading.Timer(SETTINGS.patience_s, os._exit, (SETTINGS.exit_code,))
            watch.daemon = True
            watch.start()
            os.kill(os.getpid(), signal.SIGTERM)
