"""Robust spread of normal variables; the module does not import Numba."""

NORMAL_MAD = 1.482602218505602
"""Standard deviation of a normal variable divided by the median of its absolute value."""
