"""Identification of a rig's parameters from runs, with what determined each, and comparison of model and runs."""
