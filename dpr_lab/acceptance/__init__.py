"""Acceptance test of a rig: equivalence tests of the limits in a file, based on a diagnosis."""
