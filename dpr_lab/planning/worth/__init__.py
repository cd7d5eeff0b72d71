"""Worth of information: bits about causes, library, ratios and limits, and what a release adds."""
