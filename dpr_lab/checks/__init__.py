"""Results of recommended checks, and the diagnosis updated by them."""
