"""Local damage of a recording: a hand at the release, kicks, steps of a reading, rods touched at rest."""
