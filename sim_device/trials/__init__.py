"""Preparation of blind trials by the device: drawing of a plant, size of its gap, recording, sealing."""
