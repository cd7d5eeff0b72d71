"""The scale of absolute sizes: the assumed b, and its uncertainty by the rig file."""
