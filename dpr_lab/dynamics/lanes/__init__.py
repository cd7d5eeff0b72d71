"""Lanes: simultaneous Runge-Kutta integration of sixteen tracks, each one candidate on one or several segments."""
