"""HTML pages: their blocks, their template, and the terms that they explain."""
