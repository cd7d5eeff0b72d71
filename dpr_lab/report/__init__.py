"""What an identification looks like on paper: figures, tables, and one HTML file that carries both."""
