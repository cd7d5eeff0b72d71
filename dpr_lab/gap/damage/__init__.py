"""Local disturbances of a recording: hands, kicks, outliers and steps of a reading."""
