"""Physics added to the nominal model as terms: one file an effect, one line of the catalogue."""
