"""The published experiment again: its tables, its search, its figures, beside what it prints."""
