"""Conclusions: verdict, intervals, remedies and the description of the recordings."""
