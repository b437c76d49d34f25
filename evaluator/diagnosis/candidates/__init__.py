"""Effects that may be missing, in the coordinates in which they are fitted."""
