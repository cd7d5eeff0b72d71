"""Identify a rotary double pendulum and explain why its simulation differs from the rig."""

__version__ = "0.1.0"
