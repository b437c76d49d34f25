"""Import of tracks, poses and commands of other programs."""
