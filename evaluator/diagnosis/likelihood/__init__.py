"""Probability of the measured marks given the parameters of the model."""
