"""Tracks of other programs in, results for other programs out."""
