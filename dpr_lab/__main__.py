"""`python -m dpr_lab` is `dpr-lab`."""

from dpr_lab.cli import main

main()
