"""Create HTML pages from blocks, a template, and explanations of terms."""
