"""Identification of a rig's parameters from runs, with the source of each value, and comparison of models with runs."""
