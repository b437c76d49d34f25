"""The self-test: what this version claims, tried on the user's own machine."""
