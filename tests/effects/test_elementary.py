"""Branchless elementary functions compared with mpmath."""

import mpmath
import numpy as np
import pytest

from dpr_lab.effects import elementary
from dpr_lab.kernels import njit


@njit
def exp(x):
    return elementary.exp(x)


@njit
def tanh(x):
    return elementary.tanh(x)


@njit
def sincos(x):
    return elementary.sincos(x)


RNG = np.random.default_rng(0)
SIZES = 10.0 ** RNG.uniform(-12, 1.3, 3000) * RNG.choice([-1, 1], 3000)
ULPS = 2.5


def off(computed, exact):
    """Distance from the exact value, in units in the last place."""
    with mpmath.workdps(40):
        return float(abs(mpmath.mpf(float(computed)) - exact) / np.spacing(abs(float(exact))))


@pytest.mark.parametrize(("own", "exact"), [(exp, mpmath.exp), (tanh, mpmath.tanh)])
def test_exponential_and_tangent_are_exact_to_a_few_units_in_the_last_place(own, exact):
    for x in SIZES:
        with mpmath.workdps(40):
            assert off(own(x), exact(mpmath.mpf(x))) < ULPS


@pytest.mark.slow
def test_sine_and_cosine_err_by_less_than_the_last_place_of_one():
    angles = np.concatenate([SIZES, RNG.uniform(-1e5, 1e5, 3000), np.pi / 4 * np.arange(-40, 41)])
    for x in angles:
        with mpmath.workdps(40):
            sine, cosine = mpmath.sin(mpmath.mpf(float(x))), mpmath.cos(mpmath.mpf(float(x)))
        assert abs(np.subtract(sincos(x), (float(sine), float(cosine)))).max() < 1.5 * 2**-53 * max(1, abs(x) * 2**-20)


def test_large_arguments_saturate():
    assert tanh(1e9) == 1.0
    assert tanh(-1e9) == -1.0
    assert exp(-1e9) == pytest.approx(0.0, abs=1e-300)
    assert exp(1e9) == pytest.approx(np.exp(700.0))


def test_nan_stays_nan():
    assert np.isnan([exp(np.nan), tanh(np.nan), *sincos(np.nan), *sincos(np.inf)]).all()


def test_zero_is_exact():
    assert (exp(0.0), tanh(0.0), sincos(0.0)) == (1.0, 0.0, (0.0, 1.0))
