"""The runs of a request, read; each is told."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.workflows.events import OnEvent, RunRead

if TYPE_CHECKING:
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


def read_runs(files: Sequence[Path], rig: "Rig", on_event: OnEvent, any_clock: bool = True) -> "list[Run]":
    """The runs of a rig, in the order of their files.

    Raises:
        RunError: a file that is no run, or of another rig; two that hold the same recording; or, unless `any_clock`,
            one of a device whose clock is further off than a crystal's.
    """
    from dpr_lab.run import refuse_repeated, refuse_wrong_clocks
    from dpr_lab.storage.reader import load_run

    runs: list[Run] = []
    for file in files:
        runs.append(load_run(file, rig=rig))
        on_event(RunRead(file, runs[-1].name, runs[-1].notes))
    refuse_repeated(runs)
    if not any_clock:
        refuse_wrong_clocks(runs)
    return runs
