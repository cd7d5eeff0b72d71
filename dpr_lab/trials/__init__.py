"""Blind trials: a random plant is sealed, recorded, diagnosed, revealed and scored."""
