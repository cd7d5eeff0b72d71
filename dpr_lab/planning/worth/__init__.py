"""Value of a release in bits about causes, library effects, ratios and limits."""
