"""Detection of wrong descriptions of recordings (zero, unit, sign, order).

The messages name the correction.
"""
