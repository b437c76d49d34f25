"""Frames for display: exact, decoded in a separate process, as JPEG."""
