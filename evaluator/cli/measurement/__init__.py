"""Commands of the section "Measurement" of the help."""
