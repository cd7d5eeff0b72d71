"""Long work in processes of its own: the workflows that the command line runs too, with progress over a pipe."""
