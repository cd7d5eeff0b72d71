"""Warnings about the interpretation of a table, with a module for each kind of evidence."""
