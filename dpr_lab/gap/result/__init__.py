"""Result of a diagnosis, as it is saved."""

RECORD = "diagnosis.json"
"""Name of the file in the folder of `diagnose --out` that contains the output of `diagnose --json`."""
