"""Long jobs in separate processes: the workflows of the command line, with progress over a pipe."""
