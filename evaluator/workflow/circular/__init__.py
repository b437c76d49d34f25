"""The steady-state circular test of a robot: planning of its runs, and evaluation, measured and simulated."""
