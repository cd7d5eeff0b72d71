"""Acceptance test of a rig: equivalence tests of given limits, based on a diagnosis."""
