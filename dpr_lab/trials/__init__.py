"""Blind trials: random simulated rigs are sealed, recorded, diagnosed, revealed and scored."""
