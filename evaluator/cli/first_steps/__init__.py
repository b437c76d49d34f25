"""Commands of the section "First steps" of the help."""
