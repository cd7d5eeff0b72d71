"""What convinces others of a diagnosis: its domain, its uncertainty, its residuals, what it excludes."""
