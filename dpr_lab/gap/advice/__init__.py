"""What to measure or record next, and what each cause would show."""
