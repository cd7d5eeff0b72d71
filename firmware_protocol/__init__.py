"""The wire between dpr-lab and its device, for both ends: messages, framing, sessions, clock fit.

No I/O, no clock, no threads: bytes, frames and the time go in, frames and messages come out.
"""
