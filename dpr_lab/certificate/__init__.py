"""Certificates: claims of a diagnosis that others can verify by repeating it."""
