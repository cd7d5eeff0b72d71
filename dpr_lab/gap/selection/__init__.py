"""Which effects: fits, score tests, and the search over sets of effects."""
