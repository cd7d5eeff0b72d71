"""The six steps, a screen page each: they know the workspace, the device and their own jobs, never the app."""
