"""Identify rig parameters from runs, with the source of each value, and compare models with runs."""
