"""The version; it is defined here only."""

__version__ = "0.2.0"
