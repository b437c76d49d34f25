"""The report's figures: each is a function from runs to a Figure, or None if the runs lack the data."""
