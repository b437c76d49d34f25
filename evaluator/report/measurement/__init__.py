"""Sections on how well was measured."""
