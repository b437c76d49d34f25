"""The steady-state circular test of a robot: the runs to make, and what they say, measured and simulated."""
