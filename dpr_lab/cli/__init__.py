"""The `dpr-lab` command line: a thin shell over the library."""

import os
import signal
import sys

from dpr_lab.errors import DprError

INTERRUPTED = 130


def main() -> None:
    """Run `dpr-lab`; end with the exit code its help names.

    Errors for the operator become one message on stderr; everything else is a bug and keeps its traceback.
    """
    # Our matrices are small: threads of the linear algebra cost more than they give, and lanes already use the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from dpr_lab.cli.app import app
    from dpr_lab.cli.console import complain

    signal.signal(signal.SIGTERM, _terminate)
    try:
        app()
    except DprError as error:
        complain(str(error), error.exit_code)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        complain("interrupted", INTERRUPTED)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output went away (`dpr-lab ... | head`); keep the interpreter from complaining at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


def _terminate(signum: int, frame: object) -> None:
    raise KeyboardInterrupt
