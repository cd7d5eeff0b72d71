"""Segments of swings with an arm that is clamped, free or driven."""
