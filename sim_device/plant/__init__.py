"""Simulated rig with its true values: rods, effects, encoders and operator."""
