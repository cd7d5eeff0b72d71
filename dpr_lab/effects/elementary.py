"""Branch-free elementary functions, so that loops over them are vectorised.

The argument is reduced to a small remainder, for which a polynomial is exact to rounding. The result is then
reconstructed: e^x = 2^n e^r with |r| <= ln(2) / 2, and sines by quadrant. The error is below 3 units in the last place.
Source: W. J. Cody & W. Waite (1980), Software Manual for the Elementary Functions (reduction in two parts). The
coefficients of sine and cosine are those of fdlibm (Sun Microsystems, 1993), of the exponential those of its series.
"""

import math

import numpy as np

from dpr_lab.kernels import inlined


@inlined
def _expm1_parts(x: float) -> tuple[float, float]:
    """Return 2^n and e^r - 1 of the exponential of x, for |x| <= 700.

    n and r follow from x = n ln(2) + r with an integer n.
    """
    # Adding 1.5 * 2^52 rounds to an integer in the low bits.
    shifted = x * 1.4426950408889634 + 6755399441055744.0
    n = shifted - 6755399441055744.0
    r = (x - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10
    p = r * (1.0 / 6227020800.0) + 1.0 / 479001600.0
    p = p * r + 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    exponent = np.int64((np.float64(shifted).view(np.int64) << 52) + 4607182418800017408)
    return exponent.view(np.float64), r + r * r * p


@inlined
def exp(x: float) -> float:
    """Return the exponential function e^x; x is clipped to [-700, 700]."""
    scale, remainder = _expm1_parts(min(max(x, -700.0), 700.0))
    return scale + scale * remainder


@inlined
def tanh(x: float) -> float:
    """Return the hyperbolic tangent."""
    scale, remainder = _expm1_parts(min(2.0 * abs(x), 44.0))
    expm1 = scale * remainder + (scale - 1.0)
    return math.copysign(expm1 / (expm1 + 2.0), x)


@inlined
def sincos(x: float) -> tuple[float, float]:
    """Return the sine and cosine, for |x| below a million."""
    n = np.rint(x * 6.36619772367581382433e-01)
    r = (x - n * 1.57079632673412561417) - n * 6.07710050650619224932e-11
    z = r * r
    s = z * 1.58969099521155010221e-10 - 2.50507602534068634195e-08
    s = s * z + 2.75573137070700676789e-06
    s = s * z - 1.98412698298579493134e-04
    s = s * z + 8.33333333332248946124e-03
    s = r + r * z * (s * z - 1.66666666666666324348e-01)
    c = -1.13596475577881948265e-11 * z + 2.08757232129817482790e-09
    c = c * z - 2.75573143513906633035e-07
    c = c * z + 2.48015872894767294178e-05
    c = c * z - 1.38888888888741095749e-03
    c = (1.0 - 0.5 * z) + z * z * (c * z + 4.16666666666666019037e-02)
    quadrant = n - 4.0 * np.floor(0.25 * n)
    odd, second = (quadrant == 1.0) | (quadrant == 3.0), (quadrant == 1.0) | (quadrant == 2.0)
    sine, cosine = (c if odd else s), (s if odd else c)
    return -sine if quadrant >= 2.0 else sine, -cosine if second else cosine
