"""Doubts about a table, one module for each kind of evidence."""
