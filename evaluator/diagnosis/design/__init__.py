"""Experiments that would decide: candidate runs, a first plan, the next runs."""
