import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.identification.prior_update import update_prior
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.rig_tables import Parameter

TRUE = np.array([0.21, 0.19, 0.104, 0.093, 0.215, 0.00107, 0.00093, 0.00139, 0.00128])
EXACT = np.zeros((5, 5))


def measured(rig: Rig, *names: str) -> Rig:
    known = {
        name: Parameter(
            nominal=float(TRUE[PARAMETERS.index(name)]), measured=float(TRUE[PARAMETERS.index(name)]), std=1e-6
        )
        for name in names
    }
    return rig.model_copy(update={"parameters": {**rig.parameters, **known}})


def truth(rig: Rig) -> np.ndarray:
    return ratios(base_parameters(TRUE, rig.rig.L1, rig.rig.g))


def test_without_measured_values_the_nine_have_the_ratios_and_are_held_by_their_bounds_alone(paper: Rig) -> None:
    result = update_prior(truth(paper), EXACT, paper)[0]
    Z = np.array([result[name].value for name in PARAMETERS])
    assert ratios(base_parameters(Z, paper.rig.L1, paper.rig.g)) == pytest.approx(truth(paper), rel=1e-9)
    assert {value.fixed_by for value in result.values()} == {"bound"}
    assert all(value.std is None for value in result.values())


def test_four_measured_values_let_the_data_fix_the_other_five(paper: Rig) -> None:
    result = update_prior(truth(paper), EXACT, measured(paper, "m1", "m2", "mb", "l2"))[0]
    for name, true in zip(PARAMETERS, TRUE, strict=True):
        assert result[name].value == pytest.approx(true, rel=1e-4)
    assert [name for name in PARAMETERS if result[name].fixed_by == "measured"] == ["l2", "m1", "m2", "mb"]
    assert [name for name in PARAMETERS if result[name].fixed_by == "data"] == ["l1", "c1", "c2", "J1", "J2"]


def test_three_weighed_parts_leave_one_direction_that_only_bounds_hold(paper: Rig) -> None:
    result = update_prior(truth(paper), EXACT, measured(paper, "m1", "m2", "mb"))[0]
    assert {result[name].fixed_by for name in ("m1", "m2", "mb")} == {"measured"}
    assert "bound" in {result[name].fixed_by for name in ("l1", "l2", "J1", "J2", "c1", "c2")}


def test_the_uncertainty_of_a_ratio_reaches_the_parameters_it_fixes(paper: Rig) -> None:
    rig = measured(paper, "m1", "m2", "mb", "l2")
    r = truth(paper)
    covariance = np.diag((np.array([0, 0, 0, 0.01, 0]) * r) ** 2)
    result = update_prior(r, covariance, rig)[0]
    assert result["c1"].std == pytest.approx(0.01 * TRUE[5], rel=0.05)
    assert result["c2"].std is not None
    assert result["c2"].std < 1e-3 * TRUE[6]


def test_a_known_scale_leaves_two_directions_and_fixes_the_base_parameters(paper: Rig) -> None:
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    nine, absolute = update_prior(np.append(truth(paper), base[1]), np.zeros((6, 6)), paper)
    assert {value.fixed_by for value in absolute.values()} == {"data"}
    assert [absolute[name].value for name in absolute] == pytest.approx(base, rel=1e-8)
    assert [name for name in PARAMETERS if nine[name].fixed_by == "data"] == ["c1", "c2"]
    assert nine["c1"].value == pytest.approx(TRUE[5], rel=1e-8)


def test_without_a_scale_no_base_parameter_is_fixed(paper: Rig) -> None:
    _, absolute = update_prior(truth(paper), EXACT, paper)
    assert {value.fixed_by for value in absolute.values()} == {"bound"}
