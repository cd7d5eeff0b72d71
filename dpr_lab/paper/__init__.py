"""Reproduction of the published experiment: comparison of tables, search and figures with the published ones."""
