"""Design of experiments: candidate runs, a first plan, the next runs."""
