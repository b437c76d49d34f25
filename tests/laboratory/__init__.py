"""A second world: a reference simulator and a laboratory that share no code with the product they judge."""
