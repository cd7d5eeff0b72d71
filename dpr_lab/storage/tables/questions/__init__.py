"""Compose warnings about the interpretation of a table; each kind of evidence has its own module."""
