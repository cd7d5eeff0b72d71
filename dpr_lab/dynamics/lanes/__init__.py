"""Runge-Kutta integration of many tracks at once, one in each lane of a vector register.

A track is one candidate on one or more segments. `stepping` describes the method and is the first module to read.
"""
