"""Held rods are detected by their rest, and free rods never count as held."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.estimation.held_rods import FreePart, RodMotion, free_part, refuse_held, rest_fault
from dpr_lab.run import Run


@pytest.fixture(scope="module")
def swings(recorded: Callable[..., list[Run]]) -> list[Run]:
    """Record a run from each pose, with half a second of rest before the release."""
    return recorded({}, duration=3.0)


def motion(run: Run, **changes: Any) -> RodMotion:
    return replace(RodMotion(run.t, run.theta[:, 1:], run.torques), **changes)


def held(run: Run, row: int, seconds: float) -> RodMotion:
    """Stop the swing of a run at a row for some time, and then continue it."""
    rows = round(seconds * run.rate_hz)
    noise = np.random.default_rng(1).normal(0, 2e-4, (rows, 2))
    rods = run.swing.theta[:, 1:]
    rods = np.concatenate([rods[:row], rods[row] + noise, rods[row:]])
    return RodMotion(np.arange(len(rods)) / run.rate_hz, rods)


def test_a_swing_from_its_release_on_is_free_throughout(swings: list[Run]) -> None:
    for run in swings:
        swing = run.swing
        assert free_part(motion(swing), run.name) == FreePart(0, 0, len(swing.t))


@pytest.mark.parametrize("rest_s", [0.5, 0.3, 0.05])
def test_a_rest_before_the_release_is_found_of_any_length(swings: list[Run], rest_s: float) -> None:
    for run in swings:
        cut = run.between(-rest_s, np.inf)
        later = free_part(motion(cut, t=cut.t - cut.t[0]), run.name)
        assert later.rest == 0
        # A fall from 0.1 rad shows some 20 ms after its release.
        assert -0.01 < cut.t[later.start] < 0.04
        assert not rest_fault(motion(cut), later)


def test_a_rest_that_does_not_show_the_noise_says_why(swings: list[Run]) -> None:
    run = swings[0]
    swing = run.swing
    still = RodMotion(
        np.arange(200 + len(swing.t)) / run.rate_hz, np.concatenate([[swing.theta[0, 1:]] * 200, swing.theta[:, 1:]])
    )
    assert "readings are constant" in rest_fault(still, FreePart(0, 200, len(still.t)))
    assert rest_fault(still, FreePart(198, 200, len(still.t))) == "it is too short"
    assert "still" in rest_fault(still, FreePart(200, 500, len(still.t)))


def test_a_tables_own_zero_is_the_release_where_the_motion_shows_soon_after_it(swings: list[Run]) -> None:
    for run in swings:
        part = free_part(motion(run), run.name)
        assert run.t[part.start] == 0.0


def test_rods_that_are_held_in_the_middle_are_refused_with_the_options_that_cut(swings: list[Run]) -> None:
    stopped = held(swings[0], 1500, 1.0)
    with pytest.raises(RunError, match=r"x: the recording contains 2 swings.*--start-s 0 --duration-s 1.*--start-s 2"):
        free_part(stopped, "x")


def test_rods_that_are_caught_end_the_swing(swings: list[Run]) -> None:
    caught = held(swings[1], 2000, 1.5)
    caught = RodMotion(caught.t[:3400], caught.rods[:3400])
    part = free_part(caught, "x")
    assert (part.rest, part.start) == (0, 0)
    assert caught.t[part.stop] == pytest.approx(2.0, abs=0.05)


def test_driven_rods_that_hang_and_wait_are_free_and_held_ones_are_not(swings: list[Run]) -> None:
    t = np.arange(2000) / 500
    driven = np.maximum(t - 1.0, 0.0)
    rods = np.pi + 0.3 * np.stack([np.sin(4 * driven), np.sin(6 * driven)], axis=1)
    torques = np.where(t[:, None] > 1.0, 0.1, 0.0) * [1.0, -1.0]
    assert free_part(RodMotion(t, rods, torques), "x") == FreePart(0, 0, len(t))
    assert free_part(RodMotion(t, rods + 1.0, torques), "x").start == pytest.approx(500, abs=20)
    # A drive that holds the rods aside is known; a free rod at rest is held, even near hanging.
    assert free_part(RodMotion(t, rods + 1.0, np.full_like(torques, 0.1)), "x") == FreePart(0, 0, len(t))
    assert free_part(RodMotion(t, rods), "x").start == pytest.approx(500, abs=20)


def test_a_swing_that_decays_to_rest_is_free_to_the_end() -> None:
    t = np.arange(8000) / 200
    swing = np.exp(-t / 5)[:, None] * np.stack([np.cos(6 * t), np.cos(9 * t)], axis=1)
    noise = np.random.default_rng(2).normal(0, 2e-4, swing.shape)
    assert free_part(RodMotion(t, np.pi + swing + noise), "x") == FreePart(0, 0, len(t))


def test_rods_that_stand_still_throughout_are_refused(swings: list[Run]) -> None:
    rest = swings[0].between(-0.5, 0.0)
    still = RodMotion(rest.t, np.full((len(rest.t), 2), 1.0))
    with pytest.raises(
        RunError, match=r"x: the rods are at rest during the whole recording .*--columns theta1=NAME,theta2=NAME"
    ):
        free_part(still, "x")


def test_only_tables_are_asked_whether_their_rods_are_held(swings: list[Run]) -> None:
    stopped = held(swings[0], 1500, 1.0)
    theta = np.column_stack([0 * stopped.t, stopped.rods])
    run = replace(swings[0], t=stopped.t, theta=theta, counts=None)
    refuse_held([run, replace(run, keep_rest=True)])
    with pytest.raises(RunError, match="contains 2 swings"):
        refuse_held([replace(run, keep_rest=False)])


@pytest.mark.parametrize(("amplitude", "decay_s", "noise", "zero"), [(1.2, 8, 9e-3, 0.0), (1.3, 7, 2e-2, 0.15)])
def test_a_rod_that_decays_in_a_noisy_film_is_free(amplitude: float, decay_s: float, noise: float, zero: float) -> None:
    """Its turning points lie within a band of ten standard deviations for longer than a held interval."""
    t = np.arange(0.0, 30.0, 1 / 30)
    swing = np.pi + zero + amplitude * np.exp(-t / decay_s) * np.cos(4.1 * t)
    film = swing + np.random.default_rng(0).normal(0.0, noise, len(t))
    for column in (None, 0.5 * np.sin(film)):  # the second one may be the position of a cart
        part = free_part(RodMotion(t, np.column_stack([film, film]), cart=column), "film")
        assert (part.start, part.stop) == (0, len(t))


def test_a_rod_that_is_held_in_a_noisy_film_is_found() -> None:
    t = np.arange(0.0, 20.0, 1 / 30)
    swing = np.where((t > 8.0) & (t < 10.0), np.pi + 1.0, np.pi + 1.0 * np.cos(4.1 * t))
    film = swing + np.random.default_rng(0).normal(0.0, 9e-3, len(t))
    with pytest.raises(RunError, match="contains 2 swings"):
        free_part(RodMotion(t, np.column_stack([film, film])), "film")


@pytest.mark.parametrize("rest_s", [0.25, 0.6, 1.0])
def test_a_short_rest_before_the_release_is_found_in_a_noisy_film(rest_s: float) -> None:
    """The beginning of the fall lies within the band of the rest, as a turning point would."""
    t = np.arange(0.0, 5.0, 1 / 60)
    swing = np.pi + 1.3 * np.cos(5.0 * np.maximum(t - rest_s, 0.0))
    for seed in range(5):
        film = np.column_stack([swing, swing]) + np.random.default_rng(seed).normal(0.0, 6e-3, (len(t), 2))
        part = free_part(RodMotion(t, film), "film")
        assert part.rest == 0
        assert abs(t[part.start] - rest_s) < 0.06


def test_an_arm_at_rest_with_rare_readings_of_other_counts_does_not_move() -> None:
    """Fewer than 7 % of such readings do not increase the noise estimate, which is a median."""
    t = np.arange(0.0, 6.0, 0.005)
    rod = np.round((np.pi + 1.3 * np.cos(5.0 * np.maximum(t - 2.0, 0.0))) * 8192 / (2 * np.pi)) * 2 * np.pi / 8192
    rare = np.random.default_rng(0).choice([-1, 0, 1], size=len(t), p=[0.01, 0.98, 0.01])
    part = free_part(RodMotion(t, np.column_stack([rod, rod]), None, rare * 2 * np.pi / 8192), "a clamped arm")
    assert part.start == pytest.approx(400, abs=5)


@pytest.mark.parametrize(("travel", "parts"), [(0.01, 1), (0.0, 2)])
def test_a_rod_that_a_cart_carries_is_not_held(travel: float, parts: int) -> None:
    """A cart is a long arm: its angles are within the band of the rods, although the cart moves."""
    t = np.arange(0.0, 3.0, 0.01)
    still = np.clip(t, 1.0, 1.8) - 1.0
    angle = np.where(t < 1.0, np.pi - 2.4 * t**2, np.where(t < 1.8, np.pi - 2.4, np.pi - 2.4 * np.cos(4 * (t - 1.8))))
    rods = np.column_stack([angle, np.full_like(t, np.pi)])
    carried = RodMotion(t, rods, None, travel * (np.sin(t) + still))
    if parts == 1:
        assert free_part(carried, "a cart") == FreePart(0, 0, len(t))
    else:
        with pytest.raises(RunError, match="2 swings"):
            free_part(carried, "a cart")
