import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dpr_lab.report.digits import interval, pair, plus_minus, superscripts, three, with_interval, with_unit


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (10.2458, 0.0020, "10.2458 ± 0.0020"),
        (0.2, 0.004, "0.2000 ± 0.0040"),
        (0.00133, 0.0000127, "0.001330 ± 0.000013"),
        (0.000133, 0.0000127, "(1.33 ± 0.13)e-4"),
        (0.0009996, 0.0000127, "(1.000 ± 0.013)e-3"),
        (263.5, 12.3, "264 ± 12"),
        (0.0, 0.5, "0.00 ± 0.50"),
        (-0.3, 0.1, "-0.30 ± 0.10"),
        (0.20812, None, "0.208"),
        (0.20812, 0.0, "0.2081"),
    ],
)
def test_a_value_has_the_digits_that_its_uncertainty_supports(value, std, text):
    assert plus_minus(value, std) == text


@given(value=st.floats(-1e9, 1e9), relative=st.floats(1e-6, 10), scale=st.floats(1e-9, 1e3))
def test_what_is_printed_lies_within_a_twentieth_of_the_uncertainty(value, relative, scale):
    std = relative * scale
    value *= scale / 1e9

    printed = re.fullmatch(r"\(?(\S+) ± ([^)]+)\)?(?:e(-?\d+))?", plus_minus(value, std))

    assert printed
    shown, shown_std = (float(printed[i]) * 10.0 ** int(printed[3] or 0) for i in (1, 2))
    # Two digits: half a unit of the last one is at most a twentieth; whole numbers above 10 are finer.
    assert abs(shown - value) <= 0.051 * std
    assert abs(shown_std - std) <= 0.051 * std


def test_an_interval_has_the_places_of_its_value():
    assert interval(10.24241, 10.2491, value=10.2458, std=0.002) == "10.2424 to 10.2491"
    assert interval(0.0013091, 0.0013509, value=0.00133, std=0.0000127) == "0.001309 to 0.001351"
    assert interval(0.000130, 0.000135, value=0.000133, std=0.0000127) == "1.30e-4 to 1.35e-4"


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((1e-9, -1e-12, 2e-9), "1.0e-9 (0 to 2.0e-9)"),
        ((0.0, 0.0, 8.8e-9), "0 (0 to 8.8e-9)"),
        ((8.5e-4, 7e-4, 10e-4), "8.5e-4 (7.0e-4 to 1.00e-3)"),
        ((9.996e-4, 9.9e-4, 10.1e-4), "1.000e-3 (0.990e-3 to 1.010e-3)"),
    ],
)
def test_no_power_of_ten_of_zero_or_of_ten_and_more(numbers, text):
    assert with_interval(*numbers) == text


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (0.31, "0.310"),
        (1.0, "1.00"),
        (99.99, "100"),
        (48210.4, "48210"),
        (7.68e-5, "7.68e-5"),  # as in intervals
        (-1.2e7, "-1.20e7"),
        (float("nan"), "–"),
    ],
)
def test_three_digits(number, text):
    assert three(number) == text


def test_a_pair_names_inner_before_outer():
    assert pair([0.1, float("inf")]) == "0.100, –"


def test_only_powers_of_one_digit_are_superscripts() -> None:
    assert superscripts("N m (s/rad)^0.5 / (kg m^2). 1/m^4.") == "N m (s/rad)^0.5 / (kg m²). 1/m⁴."


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.80", "0.80 mN m"),
        ("0.80 (0.70 to 0.90)", "0.80 mN m (0.70 to 0.90)"),
        (with_interval(0.0, 0.0, 0.0088), "0.0000 mN m (0.0000 to 0.0088)"),
        (with_interval(-0.00028, -0.00051, -0.00005), "-2.8e-4 mN m (-5.1e-4 to -0.5e-4)"),
    ],
)
def test_a_unit_follows_the_value_and_its_power_of_ten(text, expected):
    assert with_unit(text, "mN m") == expected
