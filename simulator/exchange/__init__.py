"""Export of robots to other simulators: MuJoCo (MJCF) and Gazebo (SDF)."""
