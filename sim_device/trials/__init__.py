"""Prepare blind trials: draw a plant, compute its gap, record it, and seal it."""
