"""Simulated counts: white noise of the stated size that depends only on the seed; the simulated operator."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dpr_lab.rig_tables import Pose
from sim_device.plant.config import OperatorConfig
from sim_device.plant.encoders import BLOCK, NoisyEncoders, standard_noise
from sim_device.plant.operator import HeldRods, placement, release_speed
from sim_device.plant.sampling_faults import between_ticks
from sim_device.random_streams import RandomStream

N = 200_000


def test_noise_is_white_and_unit():
    noise = standard_noise(1, RandomStream.SWING, 1, 0, N)
    assert np.abs(noise.mean(axis=0)).max() < 4 / np.sqrt(N)
    assert np.abs(np.cov(noise.T) - np.eye(3)).max() < 5 * np.sqrt(2 / N)
    for lag in (1, 2, BLOCK):
        assert np.abs((noise[lag:] * noise[:-lag]).mean(axis=0)).max() < 5 / np.sqrt(N)


def test_streams_releases_and_seeds_share_no_noise():
    kinds = [
        (1, RandomStream.SWING, 1),
        (1, RandomStream.REST, 1),
        (1, RandomStream.IDLE, 1),
        (1, RandomStream.SWING, 2),
        (2, RandomStream.SWING, 1),
    ]
    columns = np.array([standard_noise(*kind, 0, 20_000)[:, 0] for kind in kinds])
    assert np.abs(np.corrcoef(columns) - np.eye(len(kinds))).max() < 0.04


@given(first=st.integers(0, 5 * BLOCK), count=st.integers(0, 3 * BLOCK))
def test_noise_does_not_depend_on_how_it_is_asked_for(first, count):
    whole = standard_noise(3, RandomStream.SWING, 1, 0, 8 * BLOCK)
    assert np.array_equal(standard_noise(3, RandomStream.SWING, 1, first, count), whole[first : first + count])


@pytest.mark.parametrize("noise_counts", [0.0, 0.5, 3.0])
def test_counts_scatter_as_noise_and_rounding_make_them(paper, noise_counts):
    theta = np.tile([0.1234, 2.0, 2.5], (50_000, 1))
    counts = NoisyEncoders(paper, noise_counts, 1).read(theta, RandomStream.REST, 1, 0)
    exact = paper.positions(theta[0])
    expected = 0.0 if noise_counts == 0 else np.sqrt(noise_counts**2 + 1 / 12)
    assert counts.std(axis=0) == pytest.approx(expected, rel=0.02)
    assert np.abs(counts.mean(axis=0) - exact).max() < (0.5 if noise_counts == 0 else 0.02)


@pytest.mark.parametrize("step", [4, 16])
def test_the_noise_of_a_coarse_counter_is_in_counts_too(paper, step):
    theta = np.linspace([0.1, 2.0, 2.5], [0.4, 3.0, 2.9], 20_000)
    counts = NoisyEncoders(paper, 8.0, 1, step).read(theta, RandomStream.REST, 1, 0)
    assert (counts % step == 0).all()
    expected = np.sqrt(8.0**2 + step**2 / 12)
    assert (counts - paper.positions(theta)).std(axis=0) == pytest.approx(expected, rel=0.03)


def test_angles_between_ticks_are_those_of_a_parabola():
    def angles(t):
        return np.stack([0.1 + t, 2.0 - 3 * t + 0.5 * t**2, 0.2 * t**2], axis=1)

    later = np.array([0.0, 0.25, 0.5, 1.75, -0.5])
    exact = angles(np.arange(5) + later)
    assert between_ticks(angles(np.arange(-1.0, 7.0)), later) == pytest.approx(exact, abs=1e-12)


def test_joint_2_is_read_against_the_inner_rod_over_many_turns(paper):
    turns = np.array([[0.0, np.pi + 6 * np.pi, np.pi + 2 * np.pi]])
    counts = NoisyEncoders(paper, 0.0, 1).read(turns, RandomStream.SWING, 1, 0)[0]
    assert counts.tolist() == [0, 3 * 16384, -2 * 16384]


def test_the_simulated_operator_misses_the_pose_by_the_given_amount():
    hand, pose = OperatorConfig(placement_std=0.01, release_speed_std=0.002), Pose(theta1=0.1, theta2=3.0)
    off = np.array([placement(hand, pose, 1, release) for release in range(1, 4000)]) - pose.theta
    speeds = np.array([release_speed(hand, 1, release) for release in range(1, 4000)])
    assert (off[:, 0] == 0).all()
    assert (speeds[:, 0] == 0).all()
    assert off[:, 1:].std(axis=0) == pytest.approx(0.01, rel=0.05)
    assert speeds[:, 1:].std(axis=0) == pytest.approx(0.002, rel=0.05)
    missed = placement(hand, pose, 1, 1, error=0.3) - placement(hand, pose, 1, 1)
    assert missed == pytest.approx([0.0, 0.3, 0.3])


def test_the_hand_moves_smoothly_and_ends_exactly_there():
    held = HeldRods(np.array([0.0, np.pi, np.pi]), np.array([0.0, 0.1, 3.0]), begins=2.0, takes=0.5)
    t = np.linspace(1.9, 2.5, 601)
    theta = held.theta(t)
    assert np.array_equal(theta[0], held.start)
    assert np.allclose(theta[-1], held.target, rtol=0, atol=1e-12)
    assert np.array_equal(held.theta(np.array([2.5, 9.0])), [held.target] * 2)
    speed = np.gradient(theta[:, 1], t)
    assert np.abs(speed[[0, -1]]).max() < 0.01
    assert np.abs(speed).max() == pytest.approx(1.875 * (np.pi - 0.1) / 0.5, rel=1e-3)
