"""Lanes: simultaneous Runge-Kutta integration of sixteen tracks of candidates and segments."""
