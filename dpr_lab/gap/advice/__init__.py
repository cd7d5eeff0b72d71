"""Advice: the next measurement or recording, and its expected result for each cause."""
