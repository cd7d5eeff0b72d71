"""Python code as a program: `python -m tests.program_text CODE WORDS` is `python -c CODE WORDS`.

`tests/warm_process.py` forks a module from the process with the libraries loaded, but not a text.
"""

import sys

exec(sys.argv.pop(1), {"__name__": "__main__"})
