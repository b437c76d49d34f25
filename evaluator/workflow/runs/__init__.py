"""One run of an experiment: job, stages and result."""
