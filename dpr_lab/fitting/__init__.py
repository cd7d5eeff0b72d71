"""Multiple shooting: segments with free start states, fitted by Gauss-Newton."""
