"""Recording of runs from a device: connect, hold, release, record, check."""
