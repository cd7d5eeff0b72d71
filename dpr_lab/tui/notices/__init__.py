"""Messages to the operator: shown, kept in a list, and kept in a file."""
