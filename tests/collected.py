"""Collect the tests named in the command line, for test processes that are forked later: all modules are then imported.

A test that cannot be imported is imported again by each test process, which reports it.
"""

import gc
import os
import sys

import pytest

output = os.dup(1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
pytest.main(["--collect-only", "-qqq", "-n0", "-pno:cacheprovider", *sys.argv[3:]])
os.dup2(output, 1)
gc.freeze()  # what is collected is copied in every process
