"""Scale of absolute sizes: the assumed b, and its uncertainty from the rig file."""
