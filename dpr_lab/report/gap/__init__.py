"""The report of a diagnosis: its tables, figures and page."""
