"""Run the cases of a campaign in parallel on this machine.

A case and its result are JSON values. Each worker runs one case at a time, in one thread.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from dpr_lab.child_process import worker_pool
from dpr_lab.errors import DprError
from dpr_lab.kernel_cache import compiling_simulator

Case = dict[str, Any]
CaseFunction = Callable[[Case], dict[str, Any]]
Done = tuple[Case, dict[str, Any]]
"""A case with its result; after an error, the result is a dict with the message as `error`."""


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


def _result(future: Any) -> dict[str, Any]:
    """Return the result of a case from a future of the pool.

    The error of a killed process is raised. Any other error becomes a result that contains its message.
    """
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        raise error
    if error is None:
        return future.result()
    return {"error": str(error) if isinstance(error, DprError) else f"{type(error).__name__}: {error}"}
