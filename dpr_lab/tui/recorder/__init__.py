"""Process that controls the device, so that drawing loses no samples."""
