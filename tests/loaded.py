"""Importing this loads the lab, and all that Numba loads before the first kernel; a process forked then has it.

The screen stays out: whoever draws starts by itself.
"""

import gc
import pkgutil
from importlib import import_module

from numba.core.registry import cpu_target

import dpr_lab

for module in pkgutil.walk_packages(dpr_lab.__path__, "dpr_lab."):
    if not module.name.startswith(("dpr_lab.tui", "dpr_lab.__main__", "dpr_lab.cli.tui")):
        import_module(module.name)
cpu_target.typing_context.refresh()  # pyright: ignore[reportAttributeAccessIssue]
cpu_target.target_context.refresh()  # pyright: ignore[reportAttributeAccessIssue]
gc.freeze()  # what is collected is copied in every process
