"""Create the report of a diagnosis: tables, figures and HTML page."""
