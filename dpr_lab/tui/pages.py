"""Open reports in a browser."""

import os
import sys
import webbrowser
from functools import partial
from pathlib import Path
from typing import Any

from textual.app import App

from dpr_lab.tui.texts import NOTICES


def open_page(app: App[Any], page: Path) -> None:
    """Open a page in the browser; without a desktop, show its path in a message."""
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        app.notify(f"The report is {page}. Without a desktop, it was not opened", timeout=NOTICES.news_s)
    else:
        app.run_worker(partial(webbrowser.open, page.as_uri()), thread=True, exit_on_error=False)
