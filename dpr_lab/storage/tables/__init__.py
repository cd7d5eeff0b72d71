"""A table as it was read: its numbers, what its columns mean, what of it is plausible."""
