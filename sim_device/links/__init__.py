"""How frames reach a host and come back: serial over a pty, TCP on the loopback, CAN as SLCAN or in-process."""
