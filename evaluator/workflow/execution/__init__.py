"""Work on all cores of this machine or on a Dask cluster, and compilation ahead of its use."""
