"""Value of information: bits about causes, library, ratios and limits, and the reason of each release."""
