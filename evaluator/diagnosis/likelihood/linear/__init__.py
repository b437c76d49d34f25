"""Linear views of runs: their mixed model, the normal equations of many scatters, the random effects of each run."""
