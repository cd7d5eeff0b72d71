"""Evidence for a diagnosis: valid range, prediction uncertainty, residual analysis, excluded effects."""
