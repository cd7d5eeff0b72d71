"""The report of a campaign of blind trials: its tables, figures and page."""
