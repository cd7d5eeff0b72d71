"""`dpr-lab serve`: jobs for other programs over standard streams."""

import os
import sys
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, BinaryIO

import typer


def serve(
    stdio: Annotated[bool, typer.Option("--stdio", help="Requests come from stdin, responses go to stdout.")] = False,
) -> None:
    """Run identifications, diagnoses and plans for other programs by JSON-RPC 2.0.

    All jobs run in one process, which keeps the compiled code. Each line of stdin is one request. Each line of stdout
    is one response or progress notification. At the end of stdin the server finishes the queued jobs and exits. There
    is no network port, and no method moves or releases a rod.

    Example: echo '{"jsonrpc": "2.0", "id": 1, "method": "status"}' | dpr-lab serve --stdio
    """
    if not stdio:
        raise typer.BadParameter("give --stdio: requests come from stdin; there is no network port")
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.service import RpcCode, Service

    answers = _only_answers()

    def send(message: Mapping[str, Any]) -> None:
        from dpr_lab.report.plain import as_json

        answers.write(as_json(message, indent=None).encode("utf-8") + b"\n")
        answers.flush()

    service = Service(send)
    done = False
    with Listener():  # report on stderr that kernels are compiled
        try:
            for line in _lines(sys.stdin.buffer):
                if line is None:
                    error = {"code": int(RpcCode.PARSE_ERROR), "message": "the line is longer than 1 MB"}
                    send({"jsonrpc": "2.0", "id": None, "error": error})
                elif line.strip():
                    service.receive(line)
            done = True
        finally:
            service.close(cancel=not done)


def _only_answers() -> BinaryIO:
    """Return the stream for the responses; all other output is redirected to stderr."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return answers


def _lines(stream: BinaryIO, longest: int = 1 << 20) -> Iterator[bytes | None]:
    """Yield the lines of a stream, and None for a line that is too long."""
    while line := stream.readline(longest):
        if len(line) < longest or line.endswith(b"\n"):
            yield line
            continue
        while line and not line.endswith(b"\n"):
            line = stream.readline(longest)
        yield None
