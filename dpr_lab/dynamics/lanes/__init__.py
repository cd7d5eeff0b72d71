"""Simultaneous Runge-Kutta integration of tracks in vector lanes.

A track is one candidate on some segments.
"""
