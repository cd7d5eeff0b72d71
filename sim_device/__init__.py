"""A simulated device: plant, encoders, operator and latch; it communicates only by bytes on a link."""
