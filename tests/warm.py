"""`python -m dpr_lab` again and again: a process with the libraries loaded that forks one for each.

What is asked for comes as lines of JSON on stdin: the words after `python -m dpr_lab`, the folder, the environment, and
the files of the three streams. Each is answered by a line with the exit code.
"""

import atexit
import json
import os
import runpy
import sys
import threading
import traceback
from importlib import import_module


def main() -> None:
    """Fork for every line."""
    import_module("tests.loaded")
    for line in sys.stdin:
        asked, child = json.loads(line), os.fork()
        if child == 0:
            become(**asked)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def become(words: list[str], folder: str, environment: dict[str, str], streams: list[str]) -> None:
    """Take the place of a fresh process: its words, folder, environment and streams."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for number, (name, stream) in enumerate(zip(("stdin", "stdout", "stderr"), streams, strict=True)):
        opened = os.open(stream, os.O_WRONLY if number else os.O_RDONLY)
        os.dup2(opened, number)
        os.close(opened)
        setattr(sys, name, open(number, "w" if number else "r", closefd=False))
        setattr(sys, f"__{name}__", getattr(sys, name))
    sys.argv = ["dpr_lab", *words]
    os._exit(ended())


def ended() -> int:
    """Run the program to its end, as the interpreter does, but for taking down all that is loaded; its exit code."""
    code: object = 0
    try:
        runpy.run_module("dpr_lab", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        code = end.code or 0
    except BaseException:
        traceback.print_exc()
        code = 1
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    return code if isinstance(code, int) else 1


if __name__ == "__main__":
    main()
