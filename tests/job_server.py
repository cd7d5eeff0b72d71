"""Server of `multiprocessing` that forks the jobs of the screen from a process with the libraries loaded.

Its stdout is the socket on which it listens. It ends with its stdin.
"""

import os
from multiprocessing import forkserver

if __name__ == "__main__":
    listener, alive = os.dup(1), os.dup(0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    forkserver.main(listener, alive, ["dpr_lab.tui.recorder.process", "dpr_lab.tui.jobs.jobs"])
