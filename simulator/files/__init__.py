"""Files that settings name."""
