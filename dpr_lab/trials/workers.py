"""Parallel execution of the cases of a campaign, on this machine or on a cluster.

A case and its result are JSON values. Each worker runs one case at a time, in one thread.
"""

import asyncio
import ipaddress
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any

from dpr_lab.child_process import worker_pool
from dpr_lab.errors import DprError, LinkError
from dpr_lab.kernel_cache import compiling_simulator

Case = dict[str, Any]
CaseFunction = Callable[[Case], dict[str, Any]]
Done = tuple[Case, dict[str, Any]]
"""A case and its result; after an error, the result is a dict that contains the message as `error`."""

ADDRESS = re.compile(r"(?P<scheme>tcp|tls)://(?P<host>[^/\s]+):\d+")

START_SCHEDULER = "dask scheduler --host 127.0.0.1 --dashboard-address 127.0.0.1:8787"
START_WORKERS = "dask worker {scheduler} --host 127.0.0.1 --dashboard-address 127.0.0.1:0 --nthreads 1 --nworkers auto"
"""Command that starts the workers.

The options of both commands restrict scheduler and workers to this machine. By default they listen on every interface
and execute any code that they receive.
"""


def exposure(scheduler: str) -> str | None:
    """Return a warning if others can access a scheduler address.

    The result is None for the local interface, or with TLS.
    """
    address = ADDRESS.fullmatch(scheduler)
    if address is None or address["scheme"] == "tls" or _loopback(address["host"].strip("[]")):
        return None
    return (
        f"warning: {scheduler}: anyone who can reach this scheduler or its workers over the network can run"
        f" any code there and on this machine: keep it on 127.0.0.1, or use tls:// (docs/reliability.md, A cluster)"
    )


def _loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def on_this_machine(run: CaseFunction, cases: Sequence[Case], processes: int) -> Iterator[Done]:
    """Run the cases in processes of this machine.

    The first case runs alone, so that kernels are compiled only once.

    Raises:
        DprError: a process was killed; results that were already yielded are valid.
    """
    compiling_simulator()
    try:
        with worker_pool(processes) as pool:
            for batch in (cases[:1], cases[1:]):
                pending = {pool.submit(run, case): case for case in batch}
                for future in as_completed(pending):
                    yield pending[future], _result(future)
    except BrokenProcessPool as error:
        raise DprError(
            "a process of the campaign was killed (out of memory?); run the command again to continue"
        ) from error


def on_cluster(
    run: CaseFunction, cases: Sequence[Case], scheduler: str, *, connect_s: float = 10.0, workers_s: float = 60.0
) -> Iterator[Done]:
    """Run the cases on the workers of a dask scheduler.

    dpr-lab must be installed on these workers.

    Args:
        run: a function of this package, which the workers import
        cases: JSON objects
        scheduler: address of the scheduler, for example tcp://127.0.0.1:8786
        connect_s: maximum time until the scheduler answers, s
        workers_s: maximum time until the first worker is available, s

    Raises:
        LinkError: no scheduler answers at this address, or the connection was lost.
        DprError: dask.distributed is not installed.
    """
    try:
        from distributed import Client
        from distributed import as_completed as as_arrived
    except ImportError as error:
        raise DprError("--scheduler needs dask.distributed: pip install 'dpr-lab[cluster]'") from error
    # the library logs a traceback of errors that this program reports as one message
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    if not ADDRESS.fullmatch(scheduler):
        raise LinkError(f"{scheduler}: is not an address of a scheduler; use for example tcp://127.0.0.1:8786")
    absent = (
        f"{scheduler}: no scheduler answers: check host and port, or start one with `{START_SCHEDULER}`, and"
        f" `{START_WORKERS.format(scheduler=scheduler)}`"
    )
    if not asyncio.run(_is_scheduler(scheduler, connect_s)):
        raise LinkError(absent)
    try:
        client = Client(scheduler, timeout=connect_s)
    except OSError as error:
        raise LinkError(absent) from error
    with client:
        _wait_for_workers(partial(client.wait_for_workers, 1, timeout=workers_s), scheduler)
        pending = {client.submit(run, case, pure=False): case for case in cases}
        for future in as_arrived(pending):
            if future.cancelled():
                raise LinkError(
                    f"{scheduler}: the connection to the scheduler was lost; finished trials"
                    f" are kept, run the command again to continue"
                )
            yield pending[future], _result(future)


async def _is_scheduler(address: str, patience_s: float) -> bool:
    """Return whether a dask scheduler answers at an address.

    This test is needed because a dask client may wait forever for a server of another kind.
    """
    from distributed.comm.core import connect
    from distributed.security import Security

    keys = Security().get_connection_args("client")
    try:
        comm = await asyncio.wait_for(connect(address, timeout=patience_s, **keys), 2 * patience_s)
        await comm.write({"op": "identity", "reply": True})
        answer = await asyncio.wait_for(comm.read(), patience_s)
        comm.abort()
    except Exception:  # the library raises various exceptions for bytes that are not its messages
        return False
    return isinstance(answer, dict) and answer.get("type") == "Scheduler"


def _wait_for_workers(wait: Callable[[], object], scheduler: str) -> None:
    try:
        wait()
    except TimeoutError as error:
        raise LinkError(
            f"{scheduler}: the scheduler has no workers; start some: `{START_WORKERS.format(scheduler=scheduler)}`"
        ) from error


def _result(future: Any) -> dict[str, Any]:
    """Return the result of a case from a future of a local pool or of dask.

    The error of a killed process is raised. Any other error becomes a result that contains its message.
    """
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        raise error
    if error is None:
        return future.result()
    return {"error": str(error) if isinstance(error, DprError) else f"{type(error).__name__}: {error}"}
