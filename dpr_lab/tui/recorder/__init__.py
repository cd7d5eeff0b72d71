"""Process that controls the device, so that a busy screen loses no samples."""
