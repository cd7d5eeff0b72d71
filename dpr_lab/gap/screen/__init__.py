"""Screened and thinned recordings, the input of the diagnosis."""
