"""The report's figures, each a function from runs to a finished Figure, or None where the runs cannot show it."""
