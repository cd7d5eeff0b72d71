"""Report of a diagnosis: tables, figures and HTML page."""
