"""Eigenvalues of the derivative of the accelerations by velocity, rows 1 to 3 of work.linear."""

from __future__ import annotations

from typing import Any

from simulator.compilation import compiled


@compiled()
def characteristic(work: Any) -> tuple[float, float, float]:
    """Coefficients p, q, s of x³ + p·x² + q·x + s, the characteristic polynomial of the derivative by velocity."""
    a, b, c = work[1], work[2], work[3]
    minors = a[0] * b[1] - a[1] * b[0] + a[0] * c[2] - a[2] * c[0] + b[1] * c[2] - b[2] * c[1]
    determinant = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    return -(a[0] + b[1] + c[2]), minors, -determinant


@compiled()
def is_stable(work: Any) -> bool:
    """Whether all eigenvalues of the derivative by velocity have negative real parts (Routh and Hurwitz)."""
    p, q, s = characteristic(work)
    return bool(p > 0.0 and s > 0.0 and p * q > s)


@compiled()
def growth_rate(work: Any) -> float:
    """Largest positive real eigenvalue of the derivative by velocity, 1/s; 0 where there is none.

    With steps longer than its inverse, an L-stable method would stay on an unstable equilibrium, such as a robot at
    rest whose wheels turn against each other.
    """
    p, q, s = characteristic(work)
    if p >= 0.0 and q >= 0.0 and s >= 0.0:
        return 0.0
    x = 1.0 + max(abs(p), abs(q) ** 0.5, abs(s) ** (1 / 3)) * 2.0  # beyond every root (Fujiwara's bound)
    for _ in range(100):
        slope = (3.0 * x + 2.0 * p) * x + q
        step = (((x + p) * x + q) * x + s) / slope if slope != 0.0 else 0.0
        x -= step
        if abs(step) <= 1e-3 * abs(x) or x <= 0.0:
            break
    return float(max(x, 0.0))
