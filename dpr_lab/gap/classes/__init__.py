"""How sure each effect is: classes of indistinguishable effects and their probabilities."""
