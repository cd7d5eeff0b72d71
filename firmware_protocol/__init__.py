"""Protocol between dpr-lab and its device, for both sides: messages, framing, sessions, clock fit.

The package contains no I/O, no clock and no threads. Inputs are bytes, frames and times; outputs are frames and
messages.
"""
