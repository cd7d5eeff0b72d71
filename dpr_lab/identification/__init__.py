"""Identification of a rig's parameters from runs, with the source of each value, and comparison of model and runs."""
