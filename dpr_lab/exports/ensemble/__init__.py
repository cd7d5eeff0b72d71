"""Ensembles of models sampled from the posterior, and their predictive bands."""
