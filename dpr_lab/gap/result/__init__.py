"""The result of a diagnosis, as it is saved."""
