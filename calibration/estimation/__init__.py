"""Assigned dots → camera model with covariance."""
