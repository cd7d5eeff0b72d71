"""Identification of a rig's parameters from runs, what determined each, and comparison of swings."""
