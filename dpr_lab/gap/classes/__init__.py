"""Classes of indistinguishable effects, and the probability of each class."""
