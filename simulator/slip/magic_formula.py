"""The Magic Formula of Eq. (4), sin(a·atan(x)), without branches.

A turning robot needs it eight times per right-hand side, with arguments of all sizes. The C library chooses between
several polynomials by size, and a mispredicted branch costs more than the polynomial. Here each function is a single
polynomial (Chebyshev interpolation; relative error of atan 4e-17, of sin 3e-19), after
atan(x) = atan(c) + atan((x - c)/(1 + c·x)) has reduced the argument to tan(pi/8).
"""

from __future__ import annotations

import math

from simulator.compilation import compiled

# Flags with which the compiler processes four wheels as one vector: sums in any order. Functions with these flags are
# inlined (forceinline), so that the order of sums is fixed once for each caller.
VECTORS = {"contract", "reassoc", "nsz"}
QUARTER, HALF = math.pi / 4, math.pi / 2
NEAR, FAR = math.tan(math.pi / 8), math.tan(3 * math.pi / 8)


@compiled(forceinline=True, fastmath=VECTORS)
def arctangent(x: float) -> float:
    """Arctangent of x >= 0."""
    over = x - 1.0 if x <= FAR else -1.0
    under = x + 1.0 if x <= FAR else x
    base = QUARTER if x <= FAR else HALF
    t = (x if x <= NEAR else over) / (1.0 if x <= NEAR else under)
    z = t * t
    z2 = z * z
    low = (1.0 - 0.333333333333284386 * z) + z2 * (0.199999999988551101 - 0.142857141809764668 * z)
    middle = (0.111111061804559452 - 0.0909077307480841379 * z) + z2 * (
        0.0768995349630685776 - 0.0664023393042940859 * z
    )
    high = (0.0568834922680901048 - 0.0434805221571646248 * z) + z2 * 0.0211353731576932452
    z4 = z2 * z2
    return (0.0 if x <= NEAR else base) + t * (low + z4 * (middle + z4 * high))


@compiled(forceinline=True, fastmath=VECTORS)
def sine(x: float) -> float:
    """Sine of |x| <= pi/2."""
    z = x * x
    z2 = z * z
    low = (1.0 - 0.166666666666666653 * z) + z2 * (0.00833333333333318638 - 0.000198412698412086752 * z)
    high = (2.75573192112296066e-6 - 2.50521068905695195e-8 * z) + z2 * (
        1.60589408784865599e-10 - 7.64302655797163266e-13 * z
    )
    z4 = z2 * z2
    return x * (low + z4 * (high + z4 * 2.72157494229834428e-15))


@compiled(forceinline=True, fastmath=VECTORS)
def sine_of_atan(x: float, shape: float) -> float:
    """sin(shape·atan(x)) for x >= 0 and shape <= 2, up to which shape·atan(x) <= pi."""
    angle = shape * arctangent(x)
    return sine(min(angle, math.pi - angle))


@compiled(forceinline=True, fastmath=VECTORS)
def sine_and_cosine_of_atan(x: float, shape: float) -> tuple[float, float]:
    """Sine and cosine of shape·atan(x) for x >= 0 and shape <= 2, up to which shape·atan(x) <= pi."""
    angle = shape * arctangent(x)
    return sine(min(angle, math.pi - angle)), sine(HALF - angle)
