"""Geometry of the dot gauge, and its printable sheet."""
