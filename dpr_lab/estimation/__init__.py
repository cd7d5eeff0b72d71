"""Estimation from a recording: noise, velocities, rest and motion."""
