"""How sure: classes, probabilities, intervals, detectable sizes, recordings left out."""
