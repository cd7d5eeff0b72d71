"""Messages to the operator: shown, listed, and logged in a file."""
