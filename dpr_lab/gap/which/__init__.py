"""Search over sets of effects for the causes of the gap."""
