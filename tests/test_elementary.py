"""Functions from basic operations alone: right to 1.5 units in the last place, the same bits everywhere."""

import math
import os
import platform
import re
import subprocess
import sys
import zlib
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from midnet_bench import elementary
from midnet_bench.compiled import numba
from midnet_bench.geometry import lengths

EXACT = np.longdouble  # 11 more bits than a float on x86
POINTS = 20_000
WORST_ULP = 1.5

precise = pytest.mark.skipif(np.finfo(np.longdouble).nmant < 63, reason="no reference of higher precision")


def off_ulp(own: Callable[..., float], exact: Callable[..., object], *arguments: np.ndarray) -> float:
    """The greatest error, in units in the last place of the right result."""
    found = np.array([own(*numbers) for numbers in zip(*(each.tolist() for each in arguments), strict=True)])
    wanted = np.asarray(exact(*(each.astype(EXACT) for each in arguments)))
    return float(np.max(np.abs(found - wanted) / np.spacing(np.abs(wanted.astype(np.float64)))))


def angles() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    return {
        "headings": rng.uniform(-4.0, 4.0, POINTS),
        "turns": rng.uniform(-1e6, 1e6, POINTS),
        "near axes": np.rint(rng.uniform(-6e5, 6e5, POINTS)) * (np.pi / 2.0),
        "small": 10.0 ** rng.uniform(-300.0, 0.0, POINTS),
    }


@precise
@pytest.mark.parametrize("kind", angles())
def test_sines_and_cosines(kind: str) -> None:
    numbers = angles()[kind]
    assert off_ulp(elementary.sin, np.sin, numbers) < WORST_ULP
    assert off_ulp(elementary.cos, np.cos, numbers) < WORST_ULP


@precise
def test_arc_tangents() -> None:
    rng = np.random.default_rng(2)
    y, x = rng.normal(size=(2, POINTS))
    assert off_ulp(elementary.atan2, np.arctan2, y, x) < WORST_ULP
    assert off_ulp(elementary.atan2, np.arctan2, 10.0 ** rng.uniform(-300.0, 300.0, POINTS), x) < WORST_ULP


@precise
def test_exponentials_and_logarithms() -> None:
    rng = np.random.default_rng(3)
    for low, high in ((-1.0, 1.0), (-708.0, 709.0), (-745.0, -708.0)):
        assert off_ulp(elementary.exp, np.exp, rng.uniform(low, high, POINTS)) < WORST_ULP
    for numbers in (rng.uniform(0.0, 3.0, POINTS), 10.0 ** rng.uniform(-308.0, 308.0, POINTS)):
        assert off_ulp(elementary.log, np.log, numbers) < WORST_ULP
    assert off_ulp(elementary.log, np.log, 1.0 + 1e-3 * rng.normal(size=POINTS)) < WORST_ULP


@precise
def test_lengths() -> None:
    rng = np.random.default_rng(4)
    near = rng.normal(size=(2, POINTS))
    assert off_ulp(elementary.hypot, np.hypot, *near) < WORST_ULP
    assert off_ulp(elementary.hypot, np.hypot, *10.0 ** rng.uniform(-140.0, 150.0, (2, POINTS))) < WORST_ULP
    assert lengths(near.T).tolist() == [elementary.hypot(x, y) for x, y in near.T.tolist()]


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(finite)
@example(0.0)
@example(-0.0)
@example(5e-324)
@example(1.7976931348623157e308)
@example(0.78)
@example(1e6)
@example(1e9)
def test_an_angle_has_one_direction(angle_rad: float) -> None:
    c, s = elementary.cos_sin(angle_rad)
    assert (c, s) == (elementary.cos(angle_rad), elementary.sin(angle_rad))
    assert elementary.directions(np.array([angle_rad])).tolist() == [[c, s]]
    assert (elementary.cos(-angle_rad), elementary.sin(-angle_rad)) == (c, -s)
    assert math.copysign(1.0, elementary.sin(-angle_rad)) == -math.copysign(1.0, s)
    if abs(angle_rad) < 1e6:
        assert c == pytest.approx(math.cos(angle_rad), rel=1e-15, abs=0.0)
        assert s == pytest.approx(math.sin(angle_rad), rel=1e-15, abs=0.0)
    elif abs(angle_rad) < 1e10:
        assert (c, s) == pytest.approx((math.cos(angle_rad), math.sin(angle_rad)), abs=1e-6)


@given(finite, finite)
@example(0.0, -0.0)
@example(-0.0, -1.0)
@example(0.0, 0.0)
@example(1e-308, 1e308)
def test_a_point_lies_where_the_c_library_sees_it(y: float, x: float) -> None:
    found, wanted = elementary.atan2(y, x), math.atan2(y, x)
    assert found == pytest.approx(wanted, rel=4e-16, abs=5e-324)
    assert math.copysign(1.0, found) == math.copysign(1.0, wanted)


@given(finite)
def test_an_exponential_overflows_to_infinity_and_vanishes_to_0(x: float) -> None:
    with np.errstate(over="ignore"):
        assert elementary.exp(x) == pytest.approx(float(np.exp(x)), rel=4e-16, abs=5e-324)


def test_what_is_not_finite() -> None:
    nan, inf = math.nan, math.inf
    for function in (elementary.sin, elementary.cos):
        assert all(math.isnan(function(x)) for x in (nan, inf, -inf))
    assert (elementary.exp(inf), elementary.exp(-inf)) == (inf, 0.0)
    assert (elementary.log(inf), elementary.log(0.0)) == (inf, -inf)
    assert (elementary.hypot(inf, 1.0), elementary.hypot(0.0, -0.0)) == (inf, 0.0)
    undefined = (
        elementary.exp(nan),
        elementary.log(-1.0),
        elementary.hypot(nan, 0.0),
        elementary.atan2(nan, 1.0),
    )
    assert all(map(math.isnan, undefined))


def bits() -> int:
    """A digest of what compiled code gives."""
    rng = np.random.default_rng(5)
    places = rng.normal(size=(5000, 2)).tolist()
    values = [
        value
        for x, y in places
        for value in (
            *elementary.cos_sin(x),
            *elementary.cos_sin(1e7 * x),
            elementary.atan2(y, x),
            elementary.exp(x),
            elementary.log(abs(x)),
            elementary.hypot(x, y),
        )
    ]
    return zlib.crc32(np.array(values).tobytes())


def test_no_multiplication_is_fused_with_an_addition() -> None:
    for function in (elementary._cos, elementary.exp):
        taken = "float64, float64" if function is elementary._cos else "float64"
        compiled = numba().njit(f"float64({taken})")(function.py_func)  # what is kept cannot be looked at
        (code,) = compiled.inspect_asm().values()
        assert "mulsd" in code
        assert not re.search("fn?m(add|sub)", code)


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="these settings are for x86-64")
def test_a_poorer_processor_gives_the_same_bits() -> None:
    poorer = {
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3,X86_V4",
        "NUMBA_CPU_NAME": "x86-64",
        "NUMBA_CPU_FEATURES": "",
    }
    code = "from tests.test_elementary import bits; print(bits())"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env={**os.environ, **poorer},
        capture_output=True,
        text=True,
        check=True,
    )
    assert int(done.stdout) == bits()


@given(st.floats(-1e9, 1e9), st.floats(-50.0, 50.0))
def test_python_gives_the_bits_of_the_compiled_functions(angle: float, other: float) -> None:
    compiled, interpreted = elementary, elementary._interpreted()
    for name in ("cos_sin", "sin", "cos"):
        assert getattr(interpreted, name)(angle) == getattr(compiled, name)(angle)
    assert interpreted.atan2(angle, other) == compiled.atan2(angle, other)
    numbers = np.array([other, -other, 0.0])
    assert interpreted.exponentials(numbers).tobytes() == compiled.exponentials(numbers).tobytes()
    assert interpreted.directions(numbers).tobytes() == compiled.directions(numbers).tobytes()
    assert not hasattr(interpreted.sin, "py_func")
