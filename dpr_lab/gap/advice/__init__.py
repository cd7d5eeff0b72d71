"""Advice: the next measurement or recording that distinguishes causes, and its expected result for each cause."""
