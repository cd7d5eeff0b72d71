"""Where the cases of a campaign run: processes of this machine, or the workers of a cluster.

Either way a case goes out and its result comes back as plain JSON values, one case on one thread at a time.
"""

import logging
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context, parent_process
from typing import Any

from dpr_lab.errors import DprError, LinkError

Case = dict[str, Any]
Job = Callable[[Case], dict[str, Any]]
Done = tuple[Case, dict[str, Any]]
"""A case, and its result or `error`, a sentence."""

# Set before a worker imports what reads them, which the first case makes it do.
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
ADDRESS = re.compile(r"(tcp|tls)://[^/\s]+:\d+")
CONNECT_TIMEOUT_S = 10
WORKERS_TIMEOUT_S = 60


def on_this_machine(job: Job, cases: Sequence[Case], processes: int) -> Iterator[Done]:
    """Every case as it is done. The first is run alone, so that kernels are compiled once and not in every process.

    Raises:
        DprError: a process was killed; what was yielded before stands.
    """
    with ProcessPoolExecutor(processes, get_context("spawn"), initializer=_worker) as pool:
        try:
            for some in (cases[:1], cases[1:]):
                pending = {pool.submit(job, case): case for case in some}
                for future in as_completed(pending):
                    yield pending[future], _result(future)
        except BrokenProcessPool as error:
            raise DprError("a process of the campaign was killed (out of memory?); run it again to go on") from error
        except BaseException:
            # Nobody waits for trials that will be run again.
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in active_children():
                worker.terminate()
            raise


def _worker() -> None:
    """A worker leaves Ctrl-C to the process that started it, and ends with that one, however it ended."""
    for name in THREADS:
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()


def on_cluster(job: Job, cases: Sequence[Case], scheduler: str) -> Iterator[Done]:
    """Every case as it is done by the workers of a dask scheduler, which need dpr-lab installed.

    Args:
        job: a function of this package, which the workers import
        cases: JSON objects
        scheduler: its address, such as tcp://127.0.0.1:8786

    Raises:
        LinkError: no scheduler there, or it went away.
        DprError: dask.distributed is not installed.
    """
    try:
        from distributed import Client
        from distributed import as_completed as as_arrived
    except ImportError as error:
        raise DprError("--scheduler needs dask.distributed: pip install 'dpr-lab[cluster]'") from error
    # It logs a traceback of what becomes one sentence here.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    if not ADDRESS.fullmatch(scheduler):
        raise LinkError(f"{scheduler}: is not the address of a scheduler; write for example tcp://127.0.0.1:8786")
    try:
        client = Client(scheduler, timeout=CONNECT_TIMEOUT_S)
    except OSError as error:
        raise LinkError(
            f"{scheduler}: no scheduler answers there; start one with `dask scheduler`, and"
            f" `dask worker {scheduler} --nthreads 1 --nworkers auto` on each machine"
        ) from error
    with client:
        _wait_for_workers(client.wait_for_workers, scheduler)
        pending = {client.submit(job, case, pure=False): case for case in cases}
        for future in as_arrived(pending):
            if future.cancelled():
                raise LinkError(f"{scheduler}: the scheduler is gone; what was done is kept, run it again to go on")
            yield pending[future], _result(future)


def _wait_for_workers(wait: Callable[..., object], scheduler: str) -> None:
    try:
        wait(1, timeout=WORKERS_TIMEOUT_S)
    except TimeoutError as error:
        raise LinkError(
            f"{scheduler}: the scheduler has no workers; start some: `dask worker {scheduler} --nthreads 1`"
        ) from error


def _result(future: Any) -> dict[str, Any]:
    """What a future of either kind came to; a process that died is no result."""
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        raise error
    if error is None:
        return future.result()
    return {"error": str(error) if isinstance(error, DprError) else f"{type(error).__name__}: {error}"}
