"""Process that owns the device, and the screen side of its pipe, so that drawing the screen cannot lose samples."""
