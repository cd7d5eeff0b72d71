"""Acceptance: whether a rig keeps the limits of a file, by equivalence tests on a diagnosis."""
