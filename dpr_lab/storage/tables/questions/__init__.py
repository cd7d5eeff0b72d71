"""Doubts about a table, by what shows them."""
