"""Process that controls the device, so that no samples are lost while the screen is drawn."""
