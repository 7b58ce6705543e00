"""Logarithm, exponential and arc tangent without branches and calls: what compilers can do for several numbers at once.

Polynomials that miss least at most (Lawson's weighted least squares), summed in pairs, which a processor does side by side.
Three arc tangents of the C library were half of the time of a look-up.
"""

import math

import numpy as np

from bakery.system.compiled import njit

_A = (0.99999998056, -0.333331803764, 0.199964368025, -0.142472225889, 0.108780095218, -0.0821376060739, 0.0550280834087,
      -0.0284907591517, 0.00956733138483, -0.00150930121461)
_L = (1.00000000065, -0.499999999841, 0.333333009858, -0.249999837227, 0.200025898992, -0.166695482302, 0.142134356762,
      -0.123777045464, 0.118986334012, -0.118317674311, 0.0691251397264)
_E = (0.999999999962, 1.00000000024, 0.500000010454, 0.166666651262, 0.0416662254243, 0.00833356108369, 0.0013948183413,
      0.00019775175085)
_ROOT_HALF = np.float64(math.sqrt(0.5)).view(np.int64)
_BITS, _BIAS = 52, 1023  # of the mantissa of a double, and what its exponent is stored with
_LOG_2, _QUARTER = math.log(2), math.pi / 2
_LEAST = 1e-300

# a product and a sum are rounded once where the processor can
_FAST = {"contract"}


@njit(nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True)
def log(x):
    """ln x of a normal x > 0, to 7e-10: absolute where |ln x| > 0.35, else relative."""
    bits = np.float64(x).view(np.int64) - _ROOT_HALF
    exponent = bits >> _BITS
    x = np.int64(bits - (exponent << _BITS) + _ROOT_HALF).view(np.float64) - 1  # sqrt(1/2) .. sqrt(2), less 1
    q = x * x
    p = q * q
    low = (_L[0] + x * _L[1]) + q * (_L[2] + x * _L[3])
    high = (_L[4] + x * _L[5]) + q * (_L[6] + x * _L[7]) + p * ((_L[8] + x * _L[9]) + q * _L[10])
    return exponent * _LOG_2 + x * (low + p * high)


@njit(nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True)
def exp(x):
    """exp(x) of x < 700 to 5e-11, relative; 0 for x < -700."""
    whole = math.floor(max(x, -701.0) * (1 / _LOG_2) + 0.5)
    r = x - whole * _LOG_2
    q = r * r
    p = ((_E[0] + r * _E[1]) + q * (_E[2] + r * _E[3])) + (q * q) * ((_E[4] + r * _E[5]) + q * (_E[6] + r * _E[7]))
    scale = np.int64((np.int64(whole) + _BIAS) << _BITS).view(np.float64)
    return p * scale if x > -700.0 else 0.0


@njit(nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True)
def asinh(x):
    """arsinh(x) to 7e-10, relative below 0.3."""
    size = abs(x)
    logarithm = log(size + math.sqrt(size * size + 1))
    return -logarithm if x < 0 else logarithm


@njit(nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True)
def _arctan(r, z):
    """(2/pi) arctan of r = sqrt(z) in 0 .. 1, to 6e-10."""
    q = z * z
    p = q * q
    low, high = (_A[0] + z * _A[1]) + q * (_A[2] + z * _A[3]), (_A[4] + z * _A[5]) + q * (_A[6] + z * _A[7])
    return r * (1 / _QUARTER) * (low + p * (high + p * (_A[8] + z * _A[9])))


@njit(nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True)
def quadrant(y, x):
    """(2/pi) arctan(y / x) of x, y >= 0, 0 .. 1, to 6e-10; 0 if both are 0."""
    r = min(x, y) / max(max(x, y), _LEAST)
    angle = _arctan(r, r * r)
    return 1 - angle if y > x else angle


@njit(nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True)
def quadrant_of_squares(y, x):
    """The same of x^2 and y^2: the root is not waited for."""
    z = min(x, y) / max(max(x, y), _LEAST)
    angle = _arctan(math.sqrt(z), z)
    return 1 - angle if y > x else angle
