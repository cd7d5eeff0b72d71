"""The board: its clock, and the device role of the protocol in Python or in C."""
