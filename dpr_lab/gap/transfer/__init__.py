"""Reduction of the gap by the selected effects on data that were not fitted, and size of the gap."""
