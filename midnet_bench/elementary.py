"""Sine, cosine, arc tangent, exponential, logarithm and hypotenuse from IEEE 754's basic operations alone.

A C library has several versions of each and takes one by what the processor can do. They differ in the last
bit, as do NumPy's own and those of other releases, and after a minute a trial's robots are elsewhere for it.
What is here adds, multiplies, divides and takes square roots, each rounded as the standard says and in this
order. So it gives the same bits on every x86-64 processor, whatever C library is there. numba joins no
multiplication and addition into one unless ``fastmath`` is set, which nothing here does.

An argument is reduced to a short interval, and Taylor's series does the rest; all constants are worked out
below from integers. Results lie within 1.5 units in the last place; angles beyond 1e6 rad, which no robot
has, are first reduced by the float next to a whole turn. Compiled loops and Python may call these functions.
"""

import math
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit

Floats = npt.NDArray[np.float64]

_PLACES = 256  # binary ones, of the integers that stand for numbers here
_ONE = 1 << _PLACES


def _arctan(numerator: int, denominator: int) -> int:
    total = k = 0
    power = _ONE * numerator // denominator
    while power:
        total += (-power if k % 2 else power) // (2 * k + 1)
        power = power * numerator**2 // denominator**2
        k += 1
    return total


def _split(number: int, *places: int) -> tuple[float, ...]:
    """``number`` as a sum: multiples of 2 ** -place for each of ``places``, and what is left of it."""
    parts = []
    for place in places:
        unit = 1 << (_PLACES - place)
        parts.append(math.ldexp(number // unit, -place))
        number %= unit
    return (*parts, number / _ONE)


_PI = 16 * _arctan(1, 5) - 4 * _arctan(1, 239)  # Machin
_LN_2 = sum(2 * _ONE // ((2 * k + 1) * 3 ** (2 * k + 1)) for k in range(_PLACES // 3))  # 2 artanh(1/3)
_2_PER_PI = 2.0 / math.pi
_HALF_PI_1, _HALF_PI_2, _HALF_PI_3, _HALF_PI_4 = _split(_PI // 2, 32, 64, 96)
_HALF_PI, _HALF_PI_REST = _split(_PI // 2, 52)
_WHOLE_PI, _WHOLE_PI_REST = 2.0 * _HALF_PI, 2.0 * _HALF_PI_REST
_FAR_RAD = 1e6  # up to here a count of quarter turns times the first parts of pi / 2 is exact

_ARCTANS = np.array([_split(_arctan(k, 16) if k < 16 else _PI // 4, 53) for k in range(17)])
"""(17, 2) arctan(k / 16) as a sum"""

_LN_2_1, _LN_2_2 = _split(_LN_2, 36)
_STEPS = 32  # of the exponential's argument for each doubling
_PER_STEP = _STEPS * _ONE / _LN_2
_STEP_1, _STEP_2 = _split(_LN_2 // _STEPS, 42)
_ROOT = 2 * _ONE
for _ in range(5):
    _ROOT = math.isqrt(_ROOT << _PLACES)
_POWERS = np.array([_split((_ROOT**k << _PLACES) >> _PLACES * k, 52) for k in range(_STEPS)])
"""(32, 2) 2 ** (k / 32) as a sum"""


@njit
def cos_sin(angle_rad: float) -> tuple[float, float]:
    """The cosine and the sine of an angle: the direction's x and y."""
    quarters, rest, rest_2 = _reduced(angle_rad)
    c, s = _cos(rest, rest_2), angle_rad if abs(angle_rad) < 1e-8 else _sin(rest, rest_2)
    if quarters & 1:
        c, s = -s, c
    return (-c, -s) if quarters & 2 else (c, s)


@njit
def cos(angle_rad: float) -> float:
    """The cosine of an angle."""
    return cos_sin(angle_rad)[0]


@njit
def sin(angle_rad: float) -> float:
    """The sine of an angle."""
    return cos_sin(angle_rad)[1]


@njit
def directions(angles_rad: Floats) -> Floats:
    """(n, 2) x and y of the unit vectors along (n,) angles."""
    found = np.empty((len(angles_rad), 2))
    for i in range(len(angles_rad)):
        found[i, 0], found[i, 1] = cos_sin(angles_rad[i])
    return found


@njit
def _reduced(angle_rad: float) -> tuple[int, float, float]:
    """The nearest count of quarter turns, modulo 4 or not, and what an angle has beyond it, as a sum."""
    if abs(angle_rad) <= 0.78:
        return 0, angle_rad, 0.0
    if not abs(angle_rad) < _FAR_RAD:
        if not math.isfinite(angle_rad):
            return 0, math.nan, math.nan
        angle_rad = float(np.fmod(angle_rad, 2.0 * math.pi))
    count = math.floor(angle_rad * _2_PER_PI + 0.5)
    rest, rest_2 = _sum(angle_rad - count * _HALF_PI_1, -count * _HALF_PI_2)
    rest, rest_3 = _sum(rest, -count * _HALF_PI_3)
    rest, rest_2 = _sum(rest, rest_2 + rest_3 - count * _HALF_PI_4)
    return count, rest, rest_2


@njit
def _sum(a: float, b: float) -> tuple[float, float]:
    """The sum a + b, rounded, and by how much that is too small (Knuth, TAOCP 2, 4.2.2, theorem B)."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


@njit
def _sin(x: float, x_2: float) -> float:
    """The sine of the sum, whose first part is within an eighth of a turn."""
    z = x * x
    w = z * z
    odd = -1.0 / 6.0 + w * (-1.0 / 5040.0 + w * (-1.0 / 39916800.0 + w * (-1.0 / 1307674368000.0)))
    even = 1.0 / 120.0 + w * (1.0 / 362880.0 + w * (1.0 / 6227020800.0 + w * (1.0 / 355687428096000.0)))
    return x + (x * z * (odd + z * even) + x_2 * (1.0 - 0.5 * z))


@njit
def _cos(x: float, x_2: float) -> float:
    """The cosine of the sum."""
    z = x * x
    w = z * z
    odd = 1.0 / 24.0 + w * (1.0 / 40320.0 + w * (1.0 / 479001600.0 + w * (1.0 / 20922789888000.0)))
    even = -1.0 / 720.0 + w * (-1.0 / 3628800.0 + w * (-1.0 / 87178291200.0))
    first = 1.0 - 0.5 * z
    return first + (((1.0 - first) - 0.5 * z) + (w * (odd + z * even) - x * x_2))


@njit
def atan2(y: float, x: float) -> float:
    """The direction of the point (x, y), radians, from -pi to pi; its sign is that of ``y``, 0 or not."""
    across, along = abs(y), abs(x)
    steep = across > along
    ratio = along / across if steep else across / along if along > 0.0 else 0.0 * across
    angle, angle_2 = 0.0, 0.0
    if ratio >= 1.0 / 32.0:
        k = int(16.0 * ratio + 0.5)
        angle, angle_2 = _ARCTANS[k, 0], _ARCTANS[k, 1]
        ratio = (ratio - k / 16.0) / (1.0 + k / 16.0 * ratio)
    z = ratio * ratio
    series = -1.0 / 3.0 + z * (1.0 / 5.0 + z * (-1.0 / 7.0 + z * (1.0 / 9.0 + z * (-1.0 / 11.0))))
    angle_2 += ratio * z * series
    if steep:
        angle, rest = _sum(_HALF_PI, -angle)
        ratio, angle_2 = -ratio, _HALF_PI_REST + rest - angle_2
    if math.copysign(1.0, x) < 0.0:
        angle, rest = _sum(_WHOLE_PI, -angle)
        ratio, angle_2 = -ratio, _WHOLE_PI_REST + rest - angle_2
    return math.copysign(angle + (ratio + angle_2), y)


@njit
def exp(x: float) -> float:
    """The number e to the power of x; infinity beyond the greatest float."""
    if not abs(x) < 746.0:
        return math.inf if x > 0.0 else 0.0 if x < 0.0 else x
    count = math.floor(x * _PER_STEP + 0.5)
    first, second = x - count * _STEP_1, count * _STEP_2
    r = first - second
    r_2 = (first - r) - second
    doublings, step = count >> 5, count & 31
    series = 1.0 / 2.0 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0))))
    power, power_2 = _POWERS[step, 0], _POWERS[step, 1]
    value = power + (power_2 + power * (r + (r * r * series + r_2)))
    if -1022 <= doublings <= 1023:
        scale = np.int64((doublings + 1023) << 52).view(np.float64)  # a float's exponent, in its place
        return float(value * scale)
    return math.ldexp(value, doublings)


@njit
def exponentials(x: Floats) -> Floats:
    """``exp`` of each number of an array of any shape."""
    found = np.empty_like(x)
    for place, number in np.ndenumerate(x):
        found[place] = exp(number)
    return found


@njit
def log(x: float) -> float:
    """The natural logarithm; minus infinity of 0, not a number of what is below."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else x if x > 0.0 else math.nan
    mantissa, doublings = math.frexp(x)
    if mantissa < 0.7:
        mantissa, doublings = 2.0 * mantissa, doublings - 1
    beyond = mantissa - 1.0
    s = beyond / (2.0 + beyond)
    z = s * s
    series = 0.0
    for k in range(25, 1, -2):
        series = z * (2.0 / k + series)
    return doublings * _LN_2_1 + (beyond - (s * (beyond - series) - doublings * _LN_2_2))


@njit
def hypot(x: float, y: float) -> float:
    """The length of the vector (x, y), whose numbers are 0 or between 1e-140 and 1e150."""
    return math.sqrt(x * x + y * y)


def standard_normals(rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
    """Numbers of mean 0 and variance 1.

    NumPy's sampler takes those beyond 3.654, one of 3900, from the C library's logarithm, whose last bit is
    not everywhere the same. They are rounded to 1 / 1024, so that all libraries give one number.
    """
    draws = rng.standard_normal(shape)
    beyond = np.abs(draws) > 3.65
    draws[beyond] = np.rint(draws[beyond] * 1024.0) / 1024.0
    return draws


def _interpreted() -> SimpleNamespace:
    """What is above, uncompiled."""
    functions: dict[str, Any] = dict(globals())
    for name, value in globals().items():
        if hasattr(value, "py_func"):
            functions[name] = FunctionType(value.py_func.__code__, functions, name)
    return SimpleNamespace(**functions)


from_python = _interpreted()
"""these functions as Python runs them, with the same bits: numba takes half a second for its first loop"""
