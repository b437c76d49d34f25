"""What a model leaves of the runs: on what it depends, which runs have it, its rhythm, and whether it is noise."""
