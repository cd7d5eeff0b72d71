"""JSON-RPC 2.0 service that runs jobs one after another in one child process.

Each input line is one request object. The response to a job is sent when the job ends. Until then, `progress`
notifications with the id of the request are sent. `status` and `cancel` are answered at once. A fit cannot be
interrupted. To cancel the running job, its process is therefore terminated, and the next job starts a new process. No
method moves or releases a rod.

Source: JSON-RPC 2.0 Specification, https://www.jsonrpc.org/specification; -32800 is the code of the Language Server
Protocol for a cancelled request.
"""

import contextlib
import json
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, TypeAlias

from dpr_lab.child_process import ChildFunction
from dpr_lab.errors import DprError
from dpr_lab.progress import compiling, watch_compiling
from dpr_lab.version import __version__
from dpr_lab.workflows import events
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose
from dpr_lab.workflows.identify import IdentifyRequest, identify
from dpr_lab.workflows.plan import PlanRequest, plan


class RpcCode(IntEnum):
    """Codes of error responses."""

    PARSE_ERROR = -32700
    INVALID_REQUEST = -32600
    NO_METHOD = -32601
    INVALID_PARAMS = -32602
    INTERNAL = -32603
    FAILED = -32000
    """Code of a job that failed with a message for the operator."""
    CANCELLED = -32800


Id: TypeAlias = str | int | float | None
Send: TypeAlias = Callable[[Mapping[str, Any]], None]


class RpcError(Exception):
    """Error response to a request."""

    def __init__(self, code: int, message: str, data: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        self.code, self.data = code, data


@dataclass(frozen=True, slots=True)
class Method:
    """Method of the service: a kind of job."""

    request: type
    """Request of the job. Its fields are the parameters of the method."""
    job: Callable[[Any, events.OnEvent], Any]
    """Function that runs the job. The method `to_json` of its result returns the content of the response."""


METHODS = {
    "identify": Method(IdentifyRequest, identify),
    "diagnose": Method(DiagnoseRequest, diagnose),
    "plan": Method(PlanRequest, plan),
}
"""Job of each method name. The results are those of the command with the same name and --json."""

NAMES = [*METHODS, "status", "cancel"]
"""Names of all methods."""


@dataclass(slots=True)
class _Job:
    id: Id
    answered: bool
    """Whether the client expects a response; a notification has none."""
    method: str
    """Name of the method in `METHODS`."""
    request: Any
    cancelled: bool = False


class Service:
    """Service that receives requests and sends responses and notifications.

    Args:
        send: called with each outgoing object; the calls come from any thread, one at a time
    """

    def __init__(self, send: Send) -> None:
        self._send, self._sending = send, threading.Lock()
        self._jobs: deque[_Job] = deque()
        self._running: _Job | None = None
        self._process: ChildFunction | None = None
        self._changed = threading.Condition()
        self._closed = False
        self._worker = threading.Thread(target=self._work, name="jobs")
        self._worker.start()

    def receive(self, line: bytes) -> None:
        """Handle one input line, which contains a request."""
        request: Any = None
        try:
            request = _parsed(line)
            _refuse_invalid(request)
            result = self._called(request)
            if result is not None and "id" in request:
                self._out({"id": request["id"], "result": result})
        except RpcError as error:
            known = isinstance(request, dict) and _is_id(request.get("id", True))
            if not (isinstance(request, dict) and "id" not in request and "method" in request):
                self._fail(request["id"] if known else None, error)

    def close(self, *, cancel: bool = False) -> None:
        """Finish or cancel all jobs; return when the last job has ended."""
        with self._changed:
            self._closed = True
            for job in self._all():
                if cancel:
                    self._end(job)
            self._changed.notify_all()
        self._worker.join()
        if self._process is not None:
            self._process.end()

    def _called(self, request: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """Return the immediate result of a request; return None for a job, which is queued."""
        name, params = request["method"], request.get("params", {})
        if name == "status":
            return self._status()
        if name == "cancel":
            return {"cancelled": self._cancel(params)}
        if name not in METHODS:
            raise RpcError(RpcCode.NO_METHOD, f"no method {name!r}; available: {', '.join(NAMES)}")
        job = _Job(request.get("id"), "id" in request, name, _request(METHODS[name], params))
        with self._changed:
            if job.answered and job.id in [other.id for other in self._all()]:
                raise RpcError(
                    RpcCode.INVALID_REQUEST, f"a job with the id {job.id!r} is not finished yet: use another id"
                )
            self._jobs.append(job)
            self._changed.notify_all()
        return None

    def _all(self) -> list[_Job]:
        return [*([self._running] if self._running else []), *self._jobs]

    def _status(self) -> dict[str, Any]:
        with self._changed:
            running, waiting = self._running, list(self._jobs)
        return {
            "version": __version__,
            "methods": NAMES,
            "running": running.id if running else None,
            "waiting": [job.id for job in waiting],
        }

    def _cancel(self, params: Mapping[str, Any]) -> bool:
        if set(params) != {"id"} or not _is_id(params["id"]):
            raise RpcError(RpcCode.INVALID_PARAMS, 'cancel needs the id of a job: {"id": 1}')
        with self._changed:
            jobs = [job for job in self._all() if job.id == params["id"]]
            for job in jobs:
                self._end(job)
        return bool(jobs)

    def _end(self, job: _Job) -> None:
        """Cancel a job; if it runs, end its process."""
        job.cancelled = True
        if job is self._running and self._process is not None:
            self._process.terminate()
            self._process = None

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._jobs or self._closed)
                if not self._jobs:
                    return
                self._running = self._jobs.popleft()
            self._run(self._running)
            with self._changed:
                self._running = None

    def _run(self, job: _Job) -> None:
        """Run a job in the child process and send its response."""
        with self._changed:
            if not job.cancelled and (self._process is None or not self._process.alive):
                self._process = ChildFunction(work)
            process = None if job.cancelled else self._process  # the process of a cancelled job is not used any more
        message = self._last_message(job, process)
        if not job.answered:
            return
        if job.cancelled:
            message = RpcError(RpcCode.CANCELLED, "the job was cancelled")
        if isinstance(message, RpcError):
            self._fail(job.id, message)
        else:
            self._out({"id": job.id, "result": message})

    def _last_message(self, job: _Job, process: ChildFunction | None) -> Mapping[str, Any] | RpcError:
        """Return the result or error of a job in the child process.

        Its progress is sent to the client in the meantime.
        """
        if process is None:  # cancelled before its start
            return {}
        try:
            process.pipe.send((job.method, job.request))
            while True:
                match process.pipe.recv():
                    case "compiling":
                        compiling()
                    case ("progress", progress):
                        if job.answered and not job.cancelled:
                            self._out({"method": "progress", "params": {"id": job.id, **progress}})
                    case ("failed", *details):
                        return RpcError(*details)
                    case ("done", result):
                        return result
        except (EOFError, OSError):  # the process of the job has ended
            process.end()
            return RpcError(
                RpcCode.FAILED, "the process of the job ended unexpectedly: close other programs if memory was short"
            )

    def _fail(self, identifier: Id, error: RpcError) -> None:
        body = {"code": int(error.code), "message": str(error), **({"data": dict(error.data)} if error.data else {})}
        self._out({"id": identifier, "error": body})

    def _out(self, message: Mapping[str, Any]) -> None:
        with self._sending:
            self._send({"jsonrpc": "2.0", **message})


def work(connection: Connection) -> None:
    """Run each (method, request) that arrives in this child process, until the pipe closes.

    Messages sent for each job: `compiling`, (`progress`, parameters), and finally (`done`, result) or (`failed`,
    arguments of `RpcError`).
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the service handles Ctrl-C and ends this process
    requests: SimpleQueue[tuple[str, Any]] = SimpleQueue()
    sending = threading.Lock()

    def send(message: Any) -> None:
        with sending:  # messages about the compilation can come from any thread
            connection.send(message)

    def listen() -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                requests.put(connection.recv())
        os._exit(1)  # the service has ended

    threading.Thread(target=listen, daemon=True).start()
    with watch_compiling(lambda: send("compiling")):
        while True:
            send(_done(*requests.get(), send))


def _done(name: str, request: Any, send: Callable[[Any], None]) -> tuple[Any, ...]:
    """Run a job and return its final message."""

    def on_event(event: events.Event) -> None:
        if progress := _progress(event):
            send(("progress", progress))

    try:
        return "done", METHODS[name].job(request, on_event).to_json()
    except DprError as error:
        return "failed", RpcCode.FAILED, str(error), {"kind": type(error).__name__, "exit_code": error.exit_code}
    except Exception as error:  # a bug must not end the service
        return "failed", RpcCode.INTERNAL, f"internal error: {type(error).__name__}: {error}"


def _parsed(line: bytes) -> Any:
    """Parse a line as JSON.

    Raises:
        RpcError: the line is not JSON, or contains numbers that JSON does not have.
    """

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is not a JSON number")

    try:
        return json.loads(line.decode("utf-8"), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise RpcError(RpcCode.PARSE_ERROR, f"the line is not JSON: {error}") from error


def _refuse_invalid(request: Any) -> None:
    """Refuse a value that is not a request object of JSON-RPC 2.0.

    Raises:
        RpcError: the value is not valid.
    """
    if isinstance(request, list):
        raise RpcError(RpcCode.INVALID_REQUEST, "batches are not supported: send one object on each line")
    if not isinstance(request, dict) or request.get("jsonrpc") != "2.0":
        raise RpcError(RpcCode.INVALID_REQUEST, 'a request is an object with "jsonrpc": "2.0", "method" and "id"')
    if not isinstance(request.get("method"), str):
        raise RpcError(RpcCode.INVALID_REQUEST, '"method" must be a string')
    if not _is_id(request.get("id")):
        raise RpcError(RpcCode.INVALID_REQUEST, '"id" must be a string, a number or null')
    if not isinstance(request.get("params", {}), dict):
        raise RpcError(RpcCode.INVALID_PARAMS, '"params" must be an object with named parameters')


def _is_id(value: Any) -> bool:
    return value is None or (isinstance(value, str | int | float) and not isinstance(value, bool))


def _request(method: Method, params: Mapping[str, Any]) -> Any:
    """Create the request of a job from its parameters.

    Raises:
        RpcError: unknown, missing or wrong parameters.
    """
    from pydantic import TypeAdapter, ValidationError  # slow import: every command imports the events of all jobs

    from dpr_lab.configs import key_words

    known = [field.name for field in fields(method.request)]
    if unknown := [name for name in params if name not in known]:
        raise RpcError(RpcCode.INVALID_PARAMS, f"unknown parameter {unknown[0]!r}; available: {', '.join(known)}")
    try:
        # the messages for JSON input use the terms of JSON
        return TypeAdapter(method.request).validate_json(json.dumps(dict(params)))
    except ValidationError as error:
        first = error.errors()[0]
        name = key_words(first["loc"])
        missing = f"missing parameter {name!r}; available: {', '.join(known)}"
        sentence = missing if first["type"] == "missing" else f"{name}: {first['msg']}"
        raise RpcError(RpcCode.INVALID_PARAMS, sentence) from error


def _progress(event: events.Event) -> dict[str, Any] | None:
    """Return the parameters of an event's notification, or None if it is not reported."""
    match event:
        case events.StageBegan():
            return {"event": "stage", "number": event.number, "of": event.of, "name": event.name}
        case events.FitBegan() | events.ScoreTestBegan():
            return {"event": "fit", "text": event.text}
        case events.GenerationDone():
            return {"event": "generation", "number": event.number, "of": event.at_most, "best_cost": event.best_cost}
        case events.LocalFitBegan():
            return {"event": "fit", "text": "local fit"}
        case events.RunRead():
            return {"event": "run", "name": event.name, "notes": list(event.notes)}
        case events.Warned():
            return {"event": "warning", "text": event.sentence}
        case _:
            return None
