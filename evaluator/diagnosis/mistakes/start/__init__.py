"""The start of the motors: as the file says, as the motion shows, and motion by hand before it."""
