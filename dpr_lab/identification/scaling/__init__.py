"""The scale of absolute sizes: what b they assume, and how far the rig file lets it be off."""
