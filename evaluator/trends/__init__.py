"""Several sessions of one robot, set side by side in time: what changed, when, and by how much."""
