"""What is said: where, verdict, advice, and the result model."""
