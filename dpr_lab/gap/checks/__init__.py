"""Results of recommended checks: what a measurement says of each cause, and the updated diagnosis."""
