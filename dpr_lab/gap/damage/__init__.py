"""Local damage of a recording: hands, kicks, steps of a reading, and contact at rest."""
