"""Protocol between dpr-lab and its device, for both sides: messages, framing, sessions, clock fit.

No I/O, no clock, no threads: inputs are bytes, frames and the time; outputs are frames and messages.
"""
