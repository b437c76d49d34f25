"""A package by this file, lest the `tests` of another installed distribution take its name."""
