"""Time integration of the stiff dynamics, and velocities at which all forces balance."""
