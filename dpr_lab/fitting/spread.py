"""Robust spread of normal variables; nothing here needs Numba."""

NORMAL_MAD = 1.482602218505602
"""Standard deviation of a normal variable over the median of its absolute value."""
