"""Screened and thinned recordings, as the diagnosis sees them."""
