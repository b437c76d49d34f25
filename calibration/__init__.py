"""Gauge pictures → camera model with uncertainty: pixels become millimetres on a plane above the plate."""
