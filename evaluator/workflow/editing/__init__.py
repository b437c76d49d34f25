"""Edits of user files by a front end; comments are kept, and concurrent changes are never overwritten."""
