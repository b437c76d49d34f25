"""Figures, page and overlay video."""
