"""Sections on measurement uncertainty, and the sheet of what a search for marks finds."""
