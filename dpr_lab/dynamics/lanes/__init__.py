"""Many candidates and segments side by side: sixteen tracks go through the Runge-Kutta steps together."""
