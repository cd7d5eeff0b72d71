"""Create the report of a campaign of blind trials: tables, figures and page."""
