"""Mistakes of an experiment, recognised before any physics is looked for."""
