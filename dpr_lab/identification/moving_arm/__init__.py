"""Identify a rig whose arm is free or driven."""
