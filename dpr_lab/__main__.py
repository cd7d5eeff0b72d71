"""`python -m dpr_lab`: the same as `dpr-lab`."""

from dpr_lab.cli import main

main()
