"""Sample ensembles of models from the posterior, and compute their predictive bands."""
