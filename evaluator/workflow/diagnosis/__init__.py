"""Diagnosis of one or more experiment files, and whether a stored diagnosis is up to date."""
