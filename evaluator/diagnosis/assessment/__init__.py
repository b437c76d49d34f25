"""Which model holds, how well it fits, and where it does not."""
