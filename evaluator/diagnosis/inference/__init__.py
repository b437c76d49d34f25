"""Fits of sets of effects, and the search over sets."""
