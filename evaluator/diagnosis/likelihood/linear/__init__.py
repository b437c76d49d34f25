"""Linearized runs: mixed model, normal equations for many scatters, random effects of each run."""
