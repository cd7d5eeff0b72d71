"""Worker of pytest-xdist in a process that has imported the tests: run the line of Python that execnet writes."""

import sys

if __name__ == "__main__":
    exec(eval(sys.stdin.readline()))
