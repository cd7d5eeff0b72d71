"""Estimate noise, velocities and rest intervals of a recording, without a rig model."""
