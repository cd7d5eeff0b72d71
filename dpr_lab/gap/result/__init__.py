"""The result of a diagnosis, as it is saved."""

RECORD = "diagnosis.json"
"""File in the folder of `diagnose --out`: the output of `diagnose --json`."""
