"""Where the gap is: by joint, angle, speed and time."""
