"""Frames → sub-pixel centres of the green and the yellow mark with their uncertainty."""
