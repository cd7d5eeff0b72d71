"""The screen's end of the process that owns the device."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from dpr_lab.tui.orders import Failed, Order, Report
from dpr_lab.tui.recorder_process import serve
from dpr_lab.tui.work import spawning

PATIENCE_S = 5.0
"""How long the process may take to finish its file before it is ended."""


class Recorder:
    """A process with a device, from the moment it is made until `close`.

    Args:
        url: the link to open; empty for the rig file's
        rig: rig file or built-in name
        runs: folder of the run files
        log: file for what the process prints
    """

    def __init__(self, url: str, rig: str, runs: Path, log: Path) -> None:
        context = spawning()
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, url, rig, runs, log), daemon=True)
        self._process.start()
        theirs.close()
        self._log = log
        self._over = False

    def tell(self, order: Order) -> None:
        """Give an order; one to a process that is gone is answered by the report that it is."""
        with suppress(OSError):
            self._pipe.send(order)

    def reports(self) -> Iterator[Report]:
        """What has come since the last call, without waiting."""
        while not self._over and self._pipe.poll():
            try:
                report = self._pipe.recv()
            except (EOFError, OSError):
                report = Failed(None, f"the recorder ended; connect again (what it said last is in {self._log})", False)
            self._over = isinstance(report, Failed) and not report.alive
            yield report

    def close(self) -> None:
        """Let the process finish its file, and end it; closing twice is harmless."""
        self._over = True
        self._pipe.close()
        self._process.join(PATIENCE_S)
        for insist in (self._process.terminate, self._process.kill):
            if self._process.is_alive():
                insist()
                self._process.join(PATIENCE_S)
