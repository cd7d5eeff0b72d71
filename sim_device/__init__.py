"""A device made of software: hidden plant, encoders, operator and latch, speaking only bytes on a link."""
