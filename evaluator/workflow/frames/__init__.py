"""Frames for people to look at: exact, decoded in a process of its own, as JPEG."""
