"""Sections on measurement uncertainty."""
