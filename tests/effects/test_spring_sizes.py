"""Sizes of a cable spring that can occur together."""

import numpy as np
import pytest

from dpr_lab.effects.spring import is_one_spring


def sizes(stiffness: float, cubic: float, constant: float) -> dict[str, float]:
    return {"stiffness_Nm_per_rad": stiffness, "cubic_Nm_per_rad3": cubic, "constant_Nm": constant}


def test_every_hardening_spring_with_a_rest_angle_is_possible():
    rng = np.random.default_rng(3)
    for K, K3, q0 in np.exp(rng.uniform(np.log(1e-4), np.log(1.0), (200, 3))):
        assert is_one_spring(sizes(K + 3 * K3 * q0**2, K3, K * q0 + K3 * q0**3))


@pytest.mark.parametrize(
    "simple",
    [sizes(0, 0, 0.01), sizes(0.01, 0, 0.02), sizes(0, 0.01, 0), sizes(0.01, -0.002, 0), sizes(0, -0.002, 0.01)],
)
def test_a_twisted_hose_a_linear_a_centred_and_a_softening_spring_are_possible(simple):
    assert is_one_spring(simple)


@pytest.mark.parametrize("constant", [0.0, 0.004])
def test_a_softening_term_without_stiffness_would_push_the_joint_away(constant):
    assert not is_one_spring(sizes(0.0, -0.012, constant))


def test_a_constant_with_a_hardening_term_alone_is_no_spring():
    assert not is_one_spring(sizes(0.0, 0.098, 0.06))
