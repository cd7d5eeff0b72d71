"""Tables: numbers, meaning of the columns, and plausibility."""
