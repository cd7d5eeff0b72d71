"""Which effects cause the gap: the search over sets of effects."""
