"""Certificates: claims of a diagnosis that others verify by repeating it."""
