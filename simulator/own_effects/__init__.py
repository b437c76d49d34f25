"""Effects of the user's own: read from files, and the files to begin with."""
