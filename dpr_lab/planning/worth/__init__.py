"""Value of the expected information from a release, in bits about causes, library effects, ratios and limits."""
