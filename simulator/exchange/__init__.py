"""Robots as other simulators read them: MuJoCo (MJCF) and Gazebo (SDF)."""
