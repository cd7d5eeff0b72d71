"""Multiple shooting: segments with free initial states, fitted by Gauss-Newton."""
