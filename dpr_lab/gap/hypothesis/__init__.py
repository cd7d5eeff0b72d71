"""Models with a set of effects: fits, residuals, and score tests of additional effects."""
