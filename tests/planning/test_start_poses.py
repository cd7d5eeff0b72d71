"""Start poses of planned releases: at rest, near an unstable equilibrium, repeated."""

from dataclasses import replace

import numpy as np

from dpr_lab.planning.candidates import hanging_rad, repetition, spread_poses, swinging, value
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import CandidateRelease


def test_a_single_rod_is_not_released_at_rest() -> None:
    """A pose with only the outer rod deflected leaves the inner rod alone hanging."""
    poses = spread_poses(PlanLimits(), 1, np.random.default_rng(0))
    releases = CandidateRelease(0.0, 0.0, 10.0, "inner").moved(poses)
    still = [release for release in releases if hanging_rad(release, (1.0, 1.0)) < 1e-6]
    assert still
    assert swinging(releases) == [release for release in releases if release not in still]
    assert swinging(still) == still


def test_no_release_starts_near_an_unstable_equilibrium() -> None:
    """The gravity torques are in the ratio 3 to 1, so a clamped elbow of 90 deg balances at -18 and 72 deg."""
    near, poses = np.radians(8.0), [(0.0, 0.0), (0.0, np.pi), (np.pi, 2 * np.pi)]
    upright = [CandidateRelease(a + near, b - near, 10.0) for a, b in poses]
    upright += CandidateRelease(0.0, 0.0, 10.0, "inner").moved(np.array([[near, np.pi], [2 * np.pi, 1.0]]))
    upright.append(CandidateRelease(-np.radians(18.0), np.radians(72.0), 10.0, "clamped"))
    falling = [CandidateRelease(0.0, np.pi / 2, 10.0), CandidateRelease(0.2, 0.2, 10.0, "outer")]
    falling += [CandidateRelease(0.0, np.pi / 2, 10.0, "clamped"), CandidateRelease(3.0, 3.0, 10.0)]
    assert swinging([*upright, *falling], (3.0, 1.0)) == falling
    assert swinging(upright, (3.0, 1.0)) == upright  # the limits permit nothing else


def test_a_clamped_elbow_is_not_released_with_its_centre_of_mass_below_the_joint() -> None:
    """The gravity torques are in the ratio 3 to 1, so an elbow of 90 deg hangs at 162 and 252 deg."""
    hanging = CandidateRelease(np.radians(162.0), np.radians(252.0), 10.0, "clamped")
    swings = replace(hanging, theta1=np.pi, theta2=1.5 * np.pi)
    assert swinging([hanging, swings], (3.0, 1.0)) == [swings]


def test_rods_at_rest_are_preferred_to_rods_near_upright() -> None:
    upright, hanging = CandidateRelease(0.02, 0.02, 10.0), CandidateRelease(np.pi + 0.01, np.pi, 10.0)
    assert swinging([upright, hanging]) == [hanging]


def test_a_release_that_repeats_another_one_says_so() -> None:
    first, other = CandidateRelease(0.3, 0.4, 5.0), CandidateRelease(2.0, 1.0, 5.0)
    again = replace(first, theta1=0.3 + 2 * np.pi, duration_s=9.0)
    assert repetition(again, [other, first], [], 0.02) == " (repeats release 2)"
    assert repetition(again, [other], [first], 0.02) == " (repeats a recorded release)"
    assert repetition(replace(first, theta1=0.33), [other, first], [], 0.02) == ""
    assert repetition(replace(first, mounting="clamped"), [first], [], 0.02) == ""


def test_a_pose_is_not_repeated_if_no_release_adds_information() -> None:
    first, other = CandidateRelease(0.3, 0.4, 5.0), CandidateRelease(2.0, 1.0, 5.0)
    for bits in (0.0, -1e-15):
        assert value(bits, other, [first]) > value(bits, first, [first]) > 0
    assert value(3.0, first, [first]) > value(1.0, other, [first])  # repeating is the best
