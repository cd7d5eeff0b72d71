"""Experiment planning: which releases to record next, what they are expected to show, and when there are enough."""
