"""Experiment planning: the next releases to record, their expected information, and when to stop recording."""
