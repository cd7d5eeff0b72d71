"""Reproduction of the published experiment, and comparison of tables, search and figures with the publication."""
