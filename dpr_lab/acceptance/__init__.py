"""Acceptance test of a rig: equivalence tests against given limits, based on a diagnosis."""
