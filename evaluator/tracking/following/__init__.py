"""Marks from frame to frame: prediction, search, identity."""
