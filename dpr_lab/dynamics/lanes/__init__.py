"""Simultaneous Runge-Kutta integration of sixteen tracks in vector lanes.

A track is one candidate on some segments.
"""
