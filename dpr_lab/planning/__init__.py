"""Experiment planning: the next releases, their expected information, and the stopping rule."""
