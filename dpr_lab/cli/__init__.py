"""Entry point of the program `dpr-lab`: runs a command, reports errors and handles interrupts."""

import _thread
import atexit
import errno
import gc
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from typing import Any, NoReturn

from dpr_lab.cli.bytecode import keep_bytecode
from dpr_lab.errors import DprError, OutputError, UnexpectedError

INTERRUPTED = 130
"""Exit code after Ctrl-C or SIGTERM: 128 plus the number of SIGINT, as in a shell."""


REFUSED = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO, errno.EBADF)
"""Error codes of writes that fail although this program has no bug: closed output, full disk, missing permission, I/O
error."""


def main() -> None:
    """Run `dpr-lab` and exit with the code documented in its help.

    A `DprError` is printed as one message on stderr. Any other exception is a bug: its traceback is printed too.
    """
    signal.signal(signal.SIGTERM, _interrupt)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    atexit.register(_ignore_interrupts)  # later in the shutdown, signal handlers can no longer be changed
    try:
        # The matrices are small. Threads of the linear algebra library would slow down the computation, because the
        # parallel simulations already use all cores.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # The imports create some hundred thousand objects, nearly all of which live until the end. Searching them for
        # garbage would take a tenth of the start.
        gc.set_threshold(100_000, 50, 50)
        keep_bytecode()
        _open_streams()
        sys.unraisablehook = _say_unraisable
        _run(_command)
    except DprError as error:
        _end(str(error), error.exit_code)
    except KeyboardInterrupt as stopped:
        Interrupt.heard = True
        _end(str(stopped) or "interrupted", INTERRUPTED)
    except Exception as error:
        if not (isinstance(error, OSError) and error.errno in REFUSED):
            _end_with_bug(error)
        if error.filename is not None:
            message = f"{error.filename}: {error.strerror}: free some disk space, or choose another folder"
            _end(message, OutputError.exit_code)
        _leave_stdout()
        if error.errno != errno.EPIPE:
            from dpr_lab.cli.console import say

            say(f"dpr-lab: the result cannot be written to the output: {error.strerror}")
        sys.exit(OutputError.exit_code)


def _end_with_bug(error: Exception) -> NoReturn:
    """Print the traceback and a message about a bug, and exit with the code of `UnexpectedError`."""
    traceback.print_exc()
    _end(f"unexpected error, a bug of dpr-lab: {type(error).__name__}: {error}", UnexpectedError.exit_code)


def _end(message: str, exit_code: int) -> NoReturn:
    """Print an error message and exit; Ctrl-C is ignored until the message is printed."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        from dpr_lab.cli.console import complain

        complain(message, exit_code)
        sys.stdout.flush()
    except OSError:
        _leave_stdout()
    finally:
        signal.signal(signal.SIGINT, before)
    sys.exit(exit_code)


def _leave_stdout() -> None:
    """Redirect stdout to the null device, so that a closed output or a full disk raises no further error."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stdout__.fileno() if sys.__stdout__ else 1)


def _command() -> None:
    from dpr_lab.cli.app import app

    app(prog_name="dpr-lab")


def _run(app: Callable[[], object]) -> None:
    """Run a command and flush its output.

    If a library converted an interrupt to another exception, the interrupt is raised instead of that exception.
    """
    try:
        app()
        _say_skipped_plugins()
    except SystemExit as ended:
        if ended.code == INTERRUPTED and (stopped := _interrupt_behind(ended)) is not None:
            raise stopped from None
        if isinstance(refused := ended.__context__, BrokenPipeError):
            raise refused from None  # Typer ends with 1 after a closed pipe, the code of a failed test
        sys.stdout.flush()
        _say_skipped_plugins()
        _ignore_interrupts()
        raise
    except Exception as error:
        # A compiler that is interrupted reports a failed compilation, possibly without the cause.
        if isinstance(error, DprError):
            raise
        if (stopped := _interrupt_behind(error)) is not None:
            raise stopped from None
        from dpr_lab.plugins.rows import failure

        if sentence := failure(error):
            raise UnexpectedError(sentence) from error
        raise
    sys.stdout.flush()
    _ignore_interrupts()


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C and SIGTERM from now on: the command has ended."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _say_skipped_plugins() -> None:
    from dpr_lab.cli.console import say
    from dpr_lab.plugins.rows import skipped

    for sentence in skipped():
        say(sentence)


def _interrupt_behind(error: BaseException) -> KeyboardInterrupt | None:
    """Return the interrupt that caused an exception, or None if no interrupt caused it.

    The interrupt is taken from the chain of the exception. If a library suppressed it, a new `Interrupt` is returned.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return cause
        cause = cause.__cause__ or cause.__context__
    return Interrupt() if Interrupt.raised else None


class Interrupt(KeyboardInterrupt):
    """Exception raised by Ctrl-C and SIGTERM.

    A library may suppress the exception, for example in a callback of the compiler. It is then raised again in the main
    thread.
    """

    raised = False
    """Whether Ctrl-C was pressed or SIGTERM received."""

    heard = False
    """Whether `main` has received the interrupt."""

    def __del__(self) -> None:
        if not (Interrupt.heard or sys.is_finalizing()):  # during the shutdown no thread can start
            timer = threading.Timer(0.05, _interrupt_main_thread)  # an immediate timer would fire inside this handler
            timer.daemon = True
            timer.start()


def _say_unraisable(
    unraisable: "sys.UnraisableHookArgs",
    ignored: type[BaseException] = Interrupt,
    hook: "Callable[[sys.UnraisableHookArgs], Any]" = sys.__unraisablehook__,
) -> None:
    """Report an exception that cannot be raised, except an interrupt.

    The parameters have defaults because the interpreter sets the names of this module to None during its shutdown.
    """
    if not issubclass(unraisable.exc_type, ignored):
        hook(unraisable)


def _interrupt_main_thread() -> None:
    main = threading.main_thread().ident
    if main is None or not hasattr(signal, "pthread_kill"):
        _thread.interrupt_main()
    else:
        signal.pthread_kill(main, signal.SIGINT)  # also ends a blocking wait


def _interrupt(signum: int, frame: object) -> None:
    Interrupt.raised = True
    raise Interrupt


def _open_streams() -> None:
    """Connect closed standard streams to the null device.

    Characters that the encoding of an output stream does not contain are escaped.
    """
    for fd, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != fd:
                os.dup2(opened, fd)
            setattr(sys, name, open(fd, mode, encoding="utf-8", closefd=False))
        elif mode == "w" and isinstance(stream := getattr(sys, name), io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
