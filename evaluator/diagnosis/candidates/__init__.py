"""Candidates: effects and free-form terms in the coordinates in which they are fitted."""
