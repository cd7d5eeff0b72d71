"""Import dpr-lab and all libraries that Numba imports before the first kernel, for processes that are forked later.

The screen is not imported: a process that draws starts by itself. The simulated device that such a process starts is
forked from it.
"""

import gc
import logging
import os
import pkgutil
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from importlib import import_module
from itertools import pairwise
from multiprocessing import util
from typing import Any

from numba.core.registry import cpu_target

import dpr_lab
from dpr_lab import child_process
from dpr_lab.report import figures
from dpr_lab.report.schemas import SCHEMAS
from dpr_lab.trials import sealing
from sim_device.__main__ import main as simulate
from tests.blank_figures import save_blank
from tests.schemas import validator
from tests.warm_process import starts_device


class Forked(subprocess.Popen[bytes]):
    """Forked function in place of a program that `Popen` would run, with the same pipes and methods."""

    def __init__(self, function: Callable[[], int], **options: Any) -> None:
        self._function = function
        super().__init__(["forked"], **options)

    def _execute_child(self, *details: Any) -> None:
        pipes = details[10:16]  # p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite
        self.pid = os.fork()
        if self.pid == 0:
            for number, descriptor in enumerate((pipes[0], pipes[3], pipes[5])):
                os.dup2(descriptor, number)
            os.closerange(3, 1 << 16)
            os.setsid()
            run_and_exit(self._function)
        self._child_created = True
        self._close_pipe_fds(*pipes)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]


def run_and_exit(function: Callable[[], int | None]) -> None:
    """Run the function with the three descriptors like a new process without signal handlers and logs, and exit."""
    code = 1
    for number in signal.valid_signals():
        if callable(signal.getsignal(number)) or number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    logging.getLogger().handlers.clear()
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        setattr(sys, name, open(number, "w" if number else "r", closefd=False))
    try:
        code = function() or 0
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


spawn_new: Callable[..., int] = getattr(util, "spawnv_passfds", None)  # pyright: ignore[reportAssignmentType]


def fork_spawned(executable: bytes, words: Sequence[Any], streams: Sequence[int]) -> int:
    """As `util.spawnv_passfds`, but what `multiprocessing` spawns runs in a forked process.

    A Python without the internal names below starts new processes: all tests pass, but last longer. The test of
    `tests/test_warm_process.py` that a process of a command is forked then fails.
    """
    program = str(words[-2])
    if "spawn_main" not in program:
        return spawn_new(executable, words, streams)
    if (child := os.fork()) == 0:
        for kept, following in pairwise(sorted({2, *streams, 1 << 16})):
            os.closerange(kept + 1, following)
        threading._threading_atexits.clear()  # pyright: ignore[reportAttributeAccessIssue]  of threads that ended
        sys.argv = ["-c", words[-1]]
        run_and_exit(lambda: exec(program))
    return child


for module in pkgutil.walk_packages(dpr_lab.__path__, "dpr_lab."):
    if not module.name.startswith(("dpr_lab.tui", "dpr_lab.__main__", "dpr_lab.cli.tui")):
        import_module(module.name)
for module in ("assemble", "serve", "options", "plant.plant", "links.open_link"):
    import_module(f"sim_device.{module}")
import_module("tests.one_compiler")
import_module("tests.valid_files")
figures.save_png = save_blank
for starts in (child_process, sealing):
    starts.subprocess = starts_device(  # pyright: ignore[reportAttributeAccessIssue]
        lambda words, **options: Forked(lambda: simulate([*words]), **options)
    )
if hasattr(util, "spawnv_passfds") and hasattr(threading, "_threading_atexits"):
    util.spawnv_passfds = fork_spawned
for name in SCHEMAS:
    validator(name)
cpu_target.typing_context.refresh()  # pyright: ignore[reportAttributeAccessIssue]
cpu_target.target_context.refresh()  # pyright: ignore[reportAttributeAccessIssue]
gc.freeze()  # what is collected is copied in every process
