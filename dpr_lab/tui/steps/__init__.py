"""The seven steps, one page each.

Steps use the workspace, the device and their own jobs, but never the app.
"""
