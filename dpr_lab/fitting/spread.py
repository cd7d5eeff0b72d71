"""Robust spread of normal variables; the module does not import Numba."""

NORMAL_MAD = 1.482602218505602
"""Ratio of the standard deviation of a normal variable to the median of its absolute value."""
