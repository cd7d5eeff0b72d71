"""Reproduce the published experiment, and compare tables, search and figures with the publication."""
