"""Dot centres → indices of the gauge's array."""
