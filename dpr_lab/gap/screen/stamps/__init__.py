"""Faults of the time stamps of a recording."""
