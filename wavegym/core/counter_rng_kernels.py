"""Random numbers without state for compiled kernels: SplitMix64 by counter (Steele, Lea and Flood, OOPSLA 2014).

Draw ``i`` of a key is the i-th output of SplitMix64 seeded with that key, computed directly. A draw therefore depends
on its key and its index alone, not on earlier draws: a kernel that needs fewer numbers changes no other draw. Keys are
chained: ``stream(stream(key, step), sensor)``. Everything is cast to uint64, because Numba converts the combination of
uint64 and int64 to float64. Negative integers wrap.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math

import numpy as np

from wavegym.core.kernels import inlined, kernel

_GAMMA = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: the step of the paper's counter
_STREAM = np.uint64(0xD1342543DE82EF95)  # another step, so that no key equals a draw (multiplier of Steele and Vigna)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_ONE, _12, _27, _30, _31 = (np.uint64(n) for n in (1, 12, 27, 30, 31))
_LOG = tuple(2.0 / (2 * k + 1) for k in range(11, -1, -1))  # ln((1 + t) / (1 - t)) / t in t^2, |t| < 0.172
_COS = tuple((-1.0) ** k * math.pi ** (2 * k) / math.factorial(2 * k) for k in range(11, -1, -1))  # cos(pi y) in y^2
_SIN = tuple((-1.0) ** k * math.pi ** (2 * k + 1) / math.factorial(2 * k + 1) for k in range(11, -1, -1))
_MANTISSA, _ROOT, _EXPONENT = 0xFFFFFFFFFFFFF, 0x6A09E667F3BCD, 1023  # bits of a double; mantissa of the root of 2


@kernel
def mix(x):
    """SplitMix64's output function: a bijection of the 64-bit integers."""
    z = np.uint64(x)
    z = (z ^ (z >> _30)) * _FIRST
    z = (z ^ (z >> _27)) * _SECOND
    return z ^ (z >> _31)


@kernel
def stream(key, a):
    """The uint64 key of the stream numbered by the integer ``a`` within ``key``."""
    return mix(np.uint64(key) + (np.uint64(a) + _ONE) * _STREAM)


@kernel
def uniform(key, i):
    """Draw i of ``key``, uniform over the odd multiples of 2^-53 in (0, 1): symmetric about 1/2, never 0 or 1."""
    bits = mix(np.uint64(key) + (np.uint64(i) + _ONE) * _GAMMA) >> _12
    return (np.float64(np.int64(bits)) + 0.5) * 2.0**-52  # via int64, which processors convert faster


@kernel
def exponential(key, i):
    """Draw i of ``key``, exponential with unit mean."""
    return -np.log(uniform(key, i))


@kernel
def normal(key, i):
    """Draw i of ``key``, standard normal."""
    return normal_quantile(uniform(key, i))


@kernel
def normal_quantile(p):
    """Inverse of the standard normal distribution function, relative error about 1e-16 (Wichura 1988, AS 241, PPND16).

    -inf at 0 and inf at 1, NaN outside [0, 1].
    """
    q = p - 0.5
    if abs(q) <= 0.425:
        r = 0.180625 - q * q
        return q * _central(r)
    r = np.sqrt(-np.log(min(p, 1.0 - p)))
    if r <= 5.0:
        return np.copysign(_middle(r - 1.6), q)
    return np.copysign(_far(r - 5.0) if r < np.inf else np.inf, q) if r >= 0.0 else np.nan


@kernel
def _central(r):
    top = _polynomial(
        r,
        3.3871328727963666080e0,
        1.3314166789178437745e2,
        1.9715909503065514427e3,
        1.3731693765509461125e4,
        4.5921953931549871457e4,
        6.7265770927008700853e4,
        3.3430575583588128105e4,
        2.5090809287301226727e3,
    )
    return top / _polynomial(
        r,
        1.0,
        4.2313330701600911252e1,
        6.8718700749205790830e2,
        5.3941960214247511077e3,
        2.1213794301586595867e4,
        3.9307895800092710610e4,
        2.8729085735721942674e4,
        5.2264952788528545610e3,
    )


@kernel
def _middle(r):
    top = _polynomial(
        r,
        1.42343711074968357734e0,
        4.63033784615654529590e0,
        5.76949722146069140550e0,
        3.64784832476320460504e0,
        1.27045825245236838258e0,
        2.41780725177450611770e-1,
        2.27238449892691845833e-2,
        7.74545014278341407640e-4,
    )
    return top / _polynomial(
        r,
        1.0,
        2.05319162663775882187e0,
        1.67638483018380384940e0,
        6.89767334985100004550e-1,
        1.48103976427480074590e-1,
        1.51986665636164571966e-2,
        5.47593808499534494600e-4,
        1.05075007164441684324e-9,
    )


@kernel
def _far(r):
    top = _polynomial(
        r,
        6.65790464350110377720e0,
        5.46378491116411436990e0,
        1.78482653991729133580e0,
        2.96560571828504891230e-1,
        2.65321895265761230930e-2,
        1.24266094738807843860e-3,
        2.71155556874348757815e-5,
        2.01033439929228813265e-7,
    )
    return top / _polynomial(
        r,
        1.0,
        5.99832206555887937690e-1,
        1.36929880922735805310e-1,
        1.48753612908506148525e-2,
        7.86869131145613259100e-4,
        1.84631831751005468180e-5,
        1.42151175831644588870e-7,
        2.04426310338993978564e-15,
    )


@kernel
def _polynomial(r, c0, c1, c2, c3, c4, c5, c6, c7):
    """c0 + c1 r + ... + c7 r^7 by Estrin's scheme: its products are independent of each other."""
    square = r * r
    low = (c0 + c1 * r) + (c2 + c3 * r) * square
    high = (c4 + c5 * r) + (c6 + c7 * r) * square
    return low + high * (square * square)


@kernel
def fill_normals(key, first, out):
    """Fill out (n,) with independent standard normals: Box and Muller's transform of draws first to first + n - 1.

    Draws 2 i and 2 i + 1 of ``key`` give numbers 2 i and 2 i + 1; ``first`` and n are even. LLVM vectorises the loops,
    because they have no branches and call no library: a number takes 2 ns, and 10 ns with ``normal``.
    """
    room = np.empty((4, len(out) // 2))
    radius, turn, cosine, sine = room[0], room[1], room[2], room[3]
    _pairs(key, first, radius, turn)
    _radii(radius)
    cosines_and_sines(turn, cosine, sine)
    for i in range(len(radius)):
        out[2 * i], out[2 * i + 1] = radius[i] * cosine[i], radius[i] * sine[i]


@kernel
def _pairs(key, first, one, other):
    """Uniform draws first + 2 i of ``key`` in (0, 1), and first + 2 i + 1 less a half."""
    own, begin = np.uint64(key), np.uint64(first)
    for i in range(len(one)):
        j = begin + np.uint64(2 * i)
        one[i] = uniform(own, j)
        other[i] = uniform(own, j + _ONE) - 0.5


@kernel
def _radii(draws):
    """sqrt(-2 ln u) of each draw in place: u = 2^e m with m within a factor sqrt(2) of 1, ln m by its series."""
    bits = draws.view(np.int64)
    for i in range(len(draws)):
        mantissa = bits[i] & _MANTISSA
        above = np.int64(mantissa > _ROOT)
        exponent = (bits[i] >> 52) - _EXPONENT + above
        bits[i] = mantissa | ((_EXPONENT - above) << 52)
        t = (draws[i] - 1.0) / (draws[i] + 1.0)
        draws[i] = np.sqrt(-2.0 * (exponent * 0.6931471805599453 + t * _horner(t * t, _LOG)))


@kernel
def cosines_and_sines(turns, cosines, sines):
    """cos and sin of 2 pi x for x of turns (n,), to 1e-15; three arrays."""
    for i in range(len(turns)):
        half_turns = 2.0 * (turns[i] - np.rint(turns[i]))
        over = np.rint(half_turns)  # the series hold for a quarter of a turn to either side
        y, sign = half_turns - over, 1.0 - 2.0 * abs(over)
        cosines[i] = sign * _horner(y * y, _COS)
        sines[i] = sign * (y * _horner(y * y, _SIN))


@inlined
def _horner(x, coefficients):
    """The polynomial with these coefficients, highest power first."""
    value = 0.0
    for c in coefficients:
        value = value * x + c
    return value
