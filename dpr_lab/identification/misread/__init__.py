"""Detect wrong descriptions of recordings (zero, unit, sign, order), and name the correction."""
