"""Certificates: claims of a diagnosis, which others verify by repeating it."""
