"""Diagnosis: where measurement and simulation disagree, and which missing effect explains it."""
