"""Detect incorrect descriptions of recordings (zero, unit, sign, order), and name the option that corrects them."""
