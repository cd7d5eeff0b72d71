"""Scale of absolute sizes: the assumed b, and its uncertainty."""
