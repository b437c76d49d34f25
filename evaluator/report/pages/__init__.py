"""Whole HTML pages: their frame, and those of calibration, paper and slip bench."""
