"""Long jobs of the command line in separate processes, with progress over a pipe."""
