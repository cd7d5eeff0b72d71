"""Interface of the screen to the recorder process."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from dpr_lab.child_process import ChildFunction
from dpr_lab.tui.recorder.messages import RecorderFailed, RecorderOrder, RecorderReport
from dpr_lab.tui.recorder.process import serve


class Recorder:
    """Process that controls a device from its construction until `close` is called.

    Args:
        url: link to open; empty for the link of the rig file
        rig: rig file or built-in name
        runs: folder of the run files
        log: file for the output of the process
    """

    def __init__(self, url: str, rig: str, runs: Path, log: Path) -> None:
        self._process = ChildFunction(serve, url, rig, runs, log)
        self._gone = f"the recorder ended; connect again (its last messages are in {log})"
        self._over = False

    def tell(self, order: RecorderOrder) -> None:
        """Send a command.

        If the process has ended, the command is ignored, and `reports` yields an error report.
        """
        with suppress(OSError):
            self._process.pipe.send(order)

    def reports(self) -> Iterator[RecorderReport]:
        """Yield the reports that arrived since the last call, without waiting for further reports."""
        while not self._over and self._process.pipe.poll():
            try:
                report = self._process.pipe.recv()
            except (EOFError, OSError):
                report = RecorderFailed(None, self._gone, alive=False)
            self._over = isinstance(report, RecorderFailed) and not report.alive
            yield report

    def close(self, patience_s: float = 5.0) -> None:
        """Let the process finish its file within `patience_s`, s, then terminate it.

        Repeated calls have no effect.
        """
        self._over = True
        self._process.end(patience_s)
