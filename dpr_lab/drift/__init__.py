"""What changed between groups of runs of one rig.

groups     which runs belong together: by day, by session, by label
estimates  ratios and sizes of effects of each run alone
changes    which of them moved, with simultaneous intervals, and after which group
"""
