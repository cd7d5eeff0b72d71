"""Out-of-sample gap reduction: the size of the gap before and after the named effects, on held-out recordings."""
