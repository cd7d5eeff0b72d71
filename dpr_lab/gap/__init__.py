"""Diagnosis of the gap between simulation and rig: size, location, causes, probabilities, reduction."""
