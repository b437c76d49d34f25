"""Steady planar motion fitted to poses with correlated noise."""
