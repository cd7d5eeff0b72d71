"""Links between device and host: serial over a pty, TCP on the loopback, CAN as SLCAN or in-process."""
