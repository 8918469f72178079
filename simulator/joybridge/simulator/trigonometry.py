"""Sine, cosine, arc cosine and arctangent that give the same bits on every machine.

The functions of the C library and of NumPy choose vector instructions at run time, so their last bit differs between
processors, and the same seed would not give the same bytes. These functions use only additions, multiplications,
divisions, square roots and rounding, which IEEE 754 defines exactly. Sine and cosine accept numbers and arrays, and
their error is below 1e-12 for |x| < 1e4; the arc cosine and the
arctangent accept numbers.
"""

import math

import numpy as np

from joybridge.simulator.compiled import compiled

# Taylor coefficients of sin: (-1)^k / (2k + 1)!, k = 10 .. 0. At pi/2 the next one is below 1e-18.
C10, C9, C8, C7, C6 = (
    1 / 51090942171709440000,
    -1 / 121645100408832000,
    1 / 355687428096000,
    -1 / 1307674368000,
    1 / 6227020800,
)
C5, C4, C3, C2, C1 = -1 / 39916800, 1 / 362880, -1 / 5040, 1 / 120, -1 / 6

# Pi as a sum. The first part has few enough bits that its product with a number of turns is exact.
PI_HIGH, PI_LOW = 2 * 1.57079632673412561417, 2 * 6.07710050650619224932e-11


@compiled
def sine(x):
    """Return sin(x), x in radians: a number or an array."""
    turns = np.floor(x / np.pi + 0.5)
    r = (x - turns * PI_HIGH) - turns * PI_LOW  # in [-pi/2, pi/2]; sin(x) = sin(r) * (-1)^turns
    sign = 1.0 - 2.0 * (turns - 2.0 * np.floor(turns / 2.0))
    q = r * r
    series = ((((((((C10 * q + C9) * q + C8) * q + C7) * q + C6) * q + C5) * q + C4) * q + C3) * q + C2) * q + C1
    return sign * (r + r * q * series)


@compiled
def cosine(x):
    """Return cos(x), x in radians: a number or an array."""
    return sine(x + 0.5 * np.pi)


@compiled
def arccosine(x):
    """Return arccos(x) in radians for a number in -1..1; the error is below 1e-14."""
    if x < 0.0:
        return np.pi - _acute_arccosine(-x)
    return _acute_arccosine(x)


@compiled
def _acute_arccosine(x):
    """Return arccos(x) for 0 <= x <= 1: twice the angle whose tangent is sqrt((1 - x) / (1 + x)).

    The angle is halved three times; then its series converges fast.
    """
    tangent = math.sqrt((1.0 - x) / (1.0 + x))
    for _ in range(3):
        tangent /= 1.0 + math.sqrt(1.0 + tangent * tangent)
    square = tangent * tangent
    series = 0.0
    for k in range(8, -1, -1):
        series = 1.0 / (2 * k + 1) - square * series
    return 16.0 * tangent * series


# The tangents of 15 and of 60 degrees, for the arctangent.
TAN_15, TAN_60 = 0.26794919243112270647, 1.73205080756887729353


@compiled
def arctangent(y, x):
    """Return the angle of the vector (x, y) in -pi..pi, as math.atan2 within 1e-15, for two numbers; 0 for (0, 0)."""
    longer, shorter = max(abs(x), abs(y)), min(abs(x), abs(y))
    if longer == 0.0:
        return 0.0
    t, angle = shorter / longer, 0.0
    if t > TAN_15:
        t, angle = (t * TAN_60 - 1.0) / (t + TAN_60), np.pi / 6
    q, series = t * t, 0.0
    for n in range(27, 0, -2):  # Taylor: t - t^3 / 3 + t^5 / 5 ...; at 15 degrees the next one is below 1e-18
        series = 1.0 / n - q * series
    angle += t * series
    if abs(y) > abs(x):
        angle = np.pi / 2 - angle
    if x < 0.0:
        angle = np.pi - angle
    return -angle if y < 0.0 else angle
