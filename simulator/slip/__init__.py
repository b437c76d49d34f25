"""Slip laws: bench torques → forces → law; the law of the paper, Eqs. (4) to (8)."""
