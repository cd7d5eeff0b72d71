"""Models with a set of effects: their fit, their residuals, and the score test of further effects."""
