"""Comparison of several sessions of one robot over time: what changed, when, and by how much."""
