"""Out-of-sample reduction of the gap: its size before and after the named effects, on held-out recordings."""
