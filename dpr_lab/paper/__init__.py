"""Reproduction of the published experiment: tables, search and figures, compared with the publication."""
