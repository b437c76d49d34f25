"""Physics added to the nominal model: one file an effect, found by the catalogue."""
