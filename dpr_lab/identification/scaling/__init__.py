"""Scale of absolute sizes: the inertia b or a, with its source and uncertainty."""
