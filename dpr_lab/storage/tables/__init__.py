"""Read tables of other loggers: parse numbers, interpret columns, and check plausibility."""
