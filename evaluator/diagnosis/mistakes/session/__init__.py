"""Mistakes that show by comparing the runs of a session, and by its robot."""
