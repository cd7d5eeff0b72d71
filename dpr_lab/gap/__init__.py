"""The gap between simulation and rig: how large, where, which effect, how sure, what else, how far it shrinks."""
