"""Models with a set of effects: their fits, their residuals, and the score test of further effects."""
