"""Dynamics of the rig: base parameters, equations of motion, time integration, and sensitivities."""
