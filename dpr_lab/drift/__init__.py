"""Drift: changes of parameters between groups of runs of one rig.

groups     grouping of runs by day, session or label
estimates  ratios and sizes of effects, fitted to each run alone
changes    significant changes between groups, with simultaneous intervals and change points
"""
