"""Process that owns the device, and the screen side of its pipe: drawing cannot cause lost samples."""
