"""Jobs on all cores or on a cluster, and compilation ahead of their use."""
