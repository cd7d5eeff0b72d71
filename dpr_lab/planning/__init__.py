"""Experiment planning: next releases, their expected information, and when to stop."""
