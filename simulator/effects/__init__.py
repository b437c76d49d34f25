"""Effects: physics added to the nominal model, one file each, collected by the catalogue."""
