"""Screening and thinning of the recordings before the diagnosis."""
