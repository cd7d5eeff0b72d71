"""Fit models to segments with free initial states (multiple shooting) by the Gauss-Newton method."""
