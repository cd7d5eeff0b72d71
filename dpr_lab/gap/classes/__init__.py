"""Probability of each effect: classes of indistinguishable effects and their probabilities."""
