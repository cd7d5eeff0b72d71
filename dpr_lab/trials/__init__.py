"""Blind trials: random simulated rigs are sealed, recorded, diagnosed and revealed, and the diagnoses are scored."""
