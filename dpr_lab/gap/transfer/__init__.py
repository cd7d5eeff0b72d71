"""Out-of-sample reduction of the gap by the named effects."""
