"""Simultaneous Runge-Kutta integration of sixteen tracks in vector lanes; a track is one candidate on some segments."""
