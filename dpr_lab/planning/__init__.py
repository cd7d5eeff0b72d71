"""Experiment planning: which releases to record next, their expected information, and when to stop recording."""
