"""Recordings that are read wrongly are refused, with the cause; what is right, or real and rough, is not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.errors import IdentificationError
from dpr_lab.identification.identify import identify
from dpr_lab.identification.misread import impossible, refuse_misread
from dpr_lab.rig import Rig
from dpr_lab.run import Run

PI = np.pi


@pytest.fixture(scope="module")
def swings(recorded) -> list[Run]:
    return recorded({}, duration=1.5)


def read_as(runs: list[Run], angles: Callable) -> list[Run]:
    """The runs as another reading of the same table gives them."""
    made = []
    for run in runs:
        inner, outer = angles(run.theta[:, 1], run.theta[:, 2])
        made.append(replace(run, theta=np.column_stack([run.theta[:, 0], inner, outer]), counts=None))
    return made


def test_what_is_read_rightly_passes(swings, paper: Rig) -> None:
    refuse_misread(swings, paper)
    refuse_misread(read_as(swings, lambda a, b: (-a, -b)), paper)  # the same rig seen from behind


def test_friction_that_the_rods_alone_do_not_know_passes(recorded, paper: Rig) -> None:
    refuse_misread(
        recorded({"coulomb_joint1": {"torque_Nm": 0.03}, "coulomb_joint2": {"torque_Nm": 0.01}}, duration=2.0), paper
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angles", "said"),
    [
        (lambda a, b: (a - PI, b - PI), "zero of the angles"),
        pytest.param(lambda a, b: (2 * PI - a, b), "one rod's sign", marks=pytest.mark.long),
        pytest.param(lambda a, b: (a, 2 * PI - b), "one rod's sign", marks=pytest.mark.long),
        pytest.param(lambda a, b: (a, 2 * a - b), "sign of joint 2", marks=pytest.mark.long),
        (lambda a, b: (b, a), "exchanged"),
        pytest.param(lambda a, b: (a, b - a + PI), "--angles relative", marks=pytest.mark.long),
        pytest.param(lambda a, b: (a, b + a - PI), "--angles absolute", marks=pytest.mark.long),
        pytest.param(lambda a, b: (np.degrees(a), np.degrees(b)), "--unit deg", marks=pytest.mark.long),
        pytest.param(
            lambda a, b: (PI + np.radians(a - PI), PI + np.radians(b - PI)), "--unit rad", marks=pytest.mark.long
        ),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_wrong_reading_is_refused_with_its_cause(swings, paper: Rig, angles: Callable, said: str) -> None:
    with pytest.raises(IdentificationError, match=said):
        refuse_misread(read_as(swings, angles), paper)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_identify_says_it_before_it_searches(swings, paper: Rig) -> None:
    with pytest.raises(IdentificationError, match="wrong --zero"):
        identify(read_as(swings, lambda a, b: (a - PI, b - PI)), paper)


@pytest.mark.slow
def test_a_length_in_another_unit_is_refused(swings, paper: Rig) -> None:
    millimetres = paper.model_copy(update={"rig": paper.rig.model_copy(update={"L1": 400.0})})
    with pytest.raises(IdentificationError, match="L1 and g in the rig file"):
        refuse_misread(swings, millimetres)


def test_ratios_of_positive_masses_are_possible_and_others_not(paper: Rig, rng: np.random.Generator) -> None:
    from dpr_lab.dynamics.base import base_parameters, ratios

    for _ in range(200):
        Z = np.exp(rng.uniform(np.log(1e-3), 0.0, 9)) * [paper.L1, 1, 1, 1, 1, 1e-3, 1e-3, 1e-2, 1e-2]
        assert impossible(np.asarray(ratios(base_parameters(Z, paper.L1, paper.g))), paper) == ""
    for wrong in ([-1.0, 1, 100, 0, 0], [2, 1.6, 100, 0, 0], [10, 1.6, 20, 0, 0], [np.nan, 1, 1, 1, 1]):
        assert impossible(np.array(wrong, dtype=float), paper) != ""
