"""Files of an output folder: their names, what they were made from, and whether they are up to date."""
