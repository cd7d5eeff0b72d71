"""Determine the scale of absolute sizes: the assumed b, and its uncertainty according to the rig file."""
