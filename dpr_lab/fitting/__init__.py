"""Multiple shooting: segments with free initial states, fitted by the Gauss-Newton method."""
