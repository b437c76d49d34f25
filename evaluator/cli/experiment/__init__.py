"""Commands of the section "Experiment and simulation" of the help."""
