"""Tables of other loggers: reading of numbers, interpretation of columns, checks of plausibility."""
