"""Local damage of a recording: a hand at the release, kicks, readings that step, rods that are touched at rest."""
