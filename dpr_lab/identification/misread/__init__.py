"""Recordings that were described wrongly: refused, or diagnosed with the option that corrects the description."""
