"""Warnings about the interpretation of a table, one module for each kind of evidence."""
