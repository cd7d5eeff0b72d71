import numpy as np
import pytest

from dpr_lab.dynamics.base import (
    BASE,
    RATIOS,
    added_base,
    base_from_ratios,
    base_jacobian,
    base_parameters,
    loaded,
    ratio_jacobian,
    ratios,
    rows,
)
from dpr_lab.rig import PARAMETERS
from dpr_lab.rig_tables import AddedMass

Z = np.array([0.21, 0.19, 0.11, 0.09, 0.2, 0.0011, 0.0009, 0.0014, 0.0012])
L1, G = 0.4, 9.81


def central_differences(function, x, relative=1e-6):
    steps = np.diag(relative * x)
    return np.stack([(function(x + h) - function(x - h)) / (2 * h.sum()) for h in steps], axis=-1)


def test_base_parameters_are_the_sums_written_out():
    z = dict(zip(PARAMETERS, Z, strict=True))
    base = dict(zip(BASE, base_parameters(Z, L1, G), strict=True))
    assert base["a"] == pytest.approx(z["J1"] + z["m1"] * z["l1"] ** 2 + (z["m2"] + z["mb"]) * L1**2)
    assert base["b"] == pytest.approx(z["J2"] + z["m2"] * z["l2"] ** 2)
    assert base["d"] == pytest.approx(z["m2"] * L1 * z["l2"])
    assert base["e1"] == pytest.approx((z["m1"] * z["l1"] + (z["m2"] + z["mb"]) * L1) * G)
    assert (base["c1"], base["c2"]) == (z["c1"], z["c2"])


@pytest.mark.parametrize("rod", ["inner", "outer"])
def test_an_added_mass_changes_mass_centroid_and_inertia_of_its_rod(rod):
    added = AddedMass(rod=rod, mass=0.05, position=0.3)
    with_mass = base_parameters(loaded(Z, added), L1, G)
    assert with_mass == pytest.approx(base_parameters(Z, L1, G) + added_base(added, L1, G), rel=1e-12)


def test_leading_axes_are_kept():
    many = np.array([[Z, 1.1 * Z], [0.9 * Z, Z]])
    base = base_parameters(many, L1, G)
    assert base.shape == (2, 2, len(BASE))
    assert ratios(base).shape == (2, 2, len(RATIOS))
    assert rows(base, L1, G).shape == (2, 2, 6)
    np.testing.assert_array_equal(ratios(base)[0, 0], ratios(base_parameters(Z, L1, G)))


def test_ratios_and_rows_ignore_the_scale_of_masses():
    scaled = Z * np.array([1, 1, 3, 3, 3, 3, 3, 3, 3])
    base, heavier = base_parameters(Z, L1, G), base_parameters(scaled, L1, G)
    np.testing.assert_allclose(ratios(heavier), ratios(base), rtol=1e-14)
    np.testing.assert_allclose(rows(heavier, L1, G), rows(base, L1, G), rtol=1e-14)


def test_ratios_come_back_from_the_base_parameters_they_make():
    expected = ratios(base_parameters(Z, L1, G))
    np.testing.assert_array_equal(ratios(base_from_ratios(expected)), expected)
    assert base_from_ratios(expected)[BASE.index("b")] == 1.0


def test_row_of_gravity_of_the_outer_rod():
    e2_over_a = Z[3] * Z[1] * G / base_parameters(Z, L1, G)[0]
    assert rows(base_parameters(Z, L1, G), L1, G)[3] == pytest.approx(e2_over_a)


@pytest.mark.parametrize(
    ("jacobian", "function"),
    [
        (base_jacobian, lambda z: base_parameters(z, L1, G)),
        (ratio_jacobian, lambda z: ratios(base_parameters(z, L1, G))),
    ],
    ids=["base", "ratios"],
)
def test_jacobian_is_the_derivative(jacobian, function):
    numeric = central_differences(function, Z)
    np.testing.assert_allclose(jacobian(Z, L1, G), numeric, rtol=1e-7, atol=1e-7 * np.abs(numeric).max())


def test_nine_parameters_act_through_five_ratios():
    scaled = ratio_jacobian(Z, L1, G) * Z / ratios(base_parameters(Z, L1, G))[:, None]
    assert np.linalg.matrix_rank(scaled) == 5
