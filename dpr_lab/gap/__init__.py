"""The gap between simulation and rig: how large, where, which effect, how sure, what else, what next, how far it shrinks."""
