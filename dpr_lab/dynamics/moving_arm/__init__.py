"""Simulate segments with an arm that is clamped, free or driven."""
