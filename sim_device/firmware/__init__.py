"""Simulated board: its clock, and the device side of the protocol in Python or in C."""
