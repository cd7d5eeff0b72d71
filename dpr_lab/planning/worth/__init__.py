"""Value of the information from a release: bits about causes, library, ratios and limits, and texts of reasons."""
