"""Links between device and host: serial over a pseudo-terminal, TCP on the loopback, CAN as SLCAN or in-process."""
