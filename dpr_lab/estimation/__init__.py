"""Estimate noise, velocities, and intervals of rest from a recording, without a model of the rig."""
