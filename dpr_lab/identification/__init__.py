"""Identify the parameters of a rig from runs, record the source of each value, and compare models with runs."""
