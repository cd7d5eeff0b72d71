"""Identification of rig parameters with their sources, and comparison of models with runs."""
