"""What is true of the simulated rig: rods, effects, encoders and the operator who places them."""
