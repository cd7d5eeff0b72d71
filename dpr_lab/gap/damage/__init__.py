"""Local damage of a recording: a hand at the release, kicks, steps of a reading, and contact with rods that rest."""
