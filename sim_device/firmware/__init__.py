"""The board: the device role of the protocol, in Python or in C, and its clock."""
