"""Commands of the section "Camera" of the help."""
