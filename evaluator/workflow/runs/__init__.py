"""One run of an experiment: its job, its stages, and what came of it."""
