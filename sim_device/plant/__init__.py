"""Truth of the simulated rig: rods, effects, encoders and operator."""
