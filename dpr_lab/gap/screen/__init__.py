"""Screening and thinning of the recordings, the input of the diagnosis."""
