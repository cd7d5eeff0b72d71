"""The process that owns the device, and the screen's end of it: drawing can never cost a sample."""
