"""From runs to the parameters of a rig, what fixed each, and how measured and simulated swings compare."""
