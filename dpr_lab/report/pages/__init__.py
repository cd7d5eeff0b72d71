"""HTML pages: blocks, template, and explanations of terms."""
