"""Results of recommended checks, and update of the diagnosis by a result."""
