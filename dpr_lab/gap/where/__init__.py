"""Location of the gap: by joint, angle, speed and time."""
