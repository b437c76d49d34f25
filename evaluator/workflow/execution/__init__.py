"""Parallel execution on all cores or on a Dask cluster, and precompilation of kernels."""
