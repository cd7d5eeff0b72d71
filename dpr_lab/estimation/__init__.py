"""What a recording says: noise, velocities, parameters and their uncertainty."""
