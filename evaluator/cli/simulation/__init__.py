"""Commands of the section "Simulation" of the help."""
