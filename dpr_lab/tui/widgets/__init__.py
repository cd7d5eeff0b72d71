"""Widgets of the steps: drawings, readouts, selections and dialogs."""
