"""Simulated device: plant, encoders, operator and latch.

It communicates only by bytes on a link.
"""
