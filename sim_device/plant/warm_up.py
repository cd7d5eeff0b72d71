"""Compile the kernels of a plant before a release: at once, or in another process while the device answers.

The first compilation on a computer takes one to three minutes, but a host waits only a few seconds for an answer. A
thread that compiles would prevent the device from answering for up to a second at a time.
"""

import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection

import numpy as np

from dpr_lab.child_process import ChildFunction
from dpr_lab.kernel_cache import CACHE, mark_simulator_compiled, simulator_compiled
from dpr_lab.rig import JOINTS, Rig
from sim_device.plant.config import PlantConfig
from sim_device.plant.hidden import HiddenPlant, plant_of
from sim_device.plant.plant import Plant


def warm_up(plant: HiddenPlant, rig: Rig, *, in_background: bool) -> Callable[[], bool]:
    """Compile the kernels of a plant.

    Args:
        plant: the plant
        rig: its rig
        in_background: whether a long compilation runs in another process

    Returns:
        Function that returns whether the rods can be released. Its first call starts the compilation.
    """
    plant.misread(np.zeros((1, JOINTS)), np.zeros(1), 0)  # a device reads its rods from the start
    if not in_background or CACHE is None or simulator_compiled() or not isinstance(plant, Plant):
        _swing_once(plant)
        return lambda: True
    return _Compiling(plant, rig)


class _Compiling:
    """Compilation in the background: a process fills the cache of kernels, then a thread loads the kernels from it."""

    def __init__(self, plant: Plant, rig: Rig) -> None:
        self._plant, self._rig = plant, rig
        self._loading: threading.Thread | None = None

    def __call__(self) -> bool:
        """Return whether the compilation is complete."""
        if self._loading is None:
            child = ChildFunction(_fill_cache, self._plant.config, self._rig)
            self._loading = threading.Thread(target=_load_after, args=(child, self._plant), daemon=True)
            self._loading.start()
        return not self._loading.is_alive()


def _swing_once(plant: HiddenPlant) -> None:
    plant.let_go(np.zeros(JOINTS), np.zeros(JOINTS), 1000.0, 0).theta(0, 2)
    if isinstance(plant, Plant):
        mark_simulator_compiled()


def _load_after(child: ChildFunction, plant: Plant) -> None:
    while not child.wait(1.0):
        pass
    _swing_once(plant)  # from the cache, which is fast


def _fill_cache(connection: Connection, config: PlantConfig, rig: Rig) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(connection,), daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(5)  # a connecting host has priority
    _swing_once(plant_of(config, rig))


def _end_with(connection: Connection) -> None:
    with suppress(EOFError, OSError):
        connection.recv()
    os._exit(1)
