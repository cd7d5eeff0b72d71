"""Messages to the operator: their display, their list, and their log file."""
