"""Blind trials: a plant that nobody chose is sealed, recorded, diagnosed, opened and scored."""
