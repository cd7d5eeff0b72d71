"""Fitted sets of effects: residuals, cost, and score tests of further effects."""
