"""Mistakes of an experiment, recognised before the search for effects."""
