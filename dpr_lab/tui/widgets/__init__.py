"""What steps are made of: drawings, read-outs, choices and dialogs."""
