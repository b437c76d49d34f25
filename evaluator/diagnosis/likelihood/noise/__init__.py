"""Noise: tracking noise, drift, outliers, varying friction, and unmodelled motion on open ground."""
