"""Local damage of a recording: hands, kicks and steps of a reading."""
