"""From a device to a run file: connect, hold, release, record, judge."""
