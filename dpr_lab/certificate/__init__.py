"""Certificates: claims of a diagnosis, which others can verify by repeating the diagnosis."""
