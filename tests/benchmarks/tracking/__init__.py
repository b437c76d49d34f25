"""Figures of the tracker; `python -m tests.benchmarks.tracking` says which."""
