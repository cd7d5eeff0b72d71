"""Multiple shooting: Gauss-Newton fits of models to segments with free initial states."""
