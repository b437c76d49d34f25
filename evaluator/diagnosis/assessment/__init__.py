"""Assessment of models: comparison, adequacy, disagreements and verdict."""
