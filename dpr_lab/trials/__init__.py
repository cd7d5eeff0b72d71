"""Blind trials: a random plant is sealed, recorded and diagnosed.

Its truth is then revealed and the diagnosis scored.
"""
