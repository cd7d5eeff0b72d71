"""Preprocessing of the recordings: screening for sensor faults, block averages, and division into segments."""
