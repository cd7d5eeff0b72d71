"""Create reports: tables, figures and HTML pages of identifications, diagnoses, drift and blind trials."""
