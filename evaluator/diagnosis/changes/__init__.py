"""Changes within a session: of speed and friction, of values of the laboratory, and of everything."""
