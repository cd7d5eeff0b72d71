"""A run without enough samples, duration or motion is refused; the message states the reason and the option to use."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.rig import Rig
from dpr_lab.run import Run

T = np.arange(0.0, 2.0, 0.005)


@pytest.fixture
def swing() -> Callable[..., Run]:
    def made(inner: np.ndarray, outer: np.ndarray, t: np.ndarray = T) -> Run:
        noise = np.random.default_rng(1).normal(0.0, 1e-4, (len(t), 3))
        theta = np.column_stack([np.zeros(len(t)), inner, outer]) + noise
        return Run("swing", t, theta, None, None, "paper", "", 200.0)

    return made


INNER, OUTER = np.pi + 0.5 * np.cos(7 * T), np.pi + 0.7 * np.cos(7 * T + 0.3)


def test_a_swing_passes(swing, paper: Rig) -> None:
    refuse_without_motion(swing(INNER, OUTER), paper)
    small = swing(np.pi + 0.02 * np.cos(7 * T), np.pi + 0.024 * np.cos(7 * T))
    refuse_without_motion(small, paper)  # the slow mode: the elbow turns by a fifth of joint 1


@pytest.mark.parametrize(
    ("inner", "outer", "sentence"),
    [
        (0 * T + np.pi, 0 * T + np.pi, "theta1 and theta2 are at rest .*--columns"),
        (INNER, 0 * T + np.pi, "theta2 is at rest .*--rods inner"),
        (0 * T + 1.0, OUTER, "theta1 is at rest .*--columns"),
        (INNER, INNER + 1.0, "joint 2 does not turn: .* --elbow clamped"),
        (INNER, INNER, 'elbow = "clamped"'),
    ],
)
def test_a_joint_that_stands_still_is_named(swing, paper: Rig, inner, outer, sentence: str) -> None:
    with pytest.raises(RunError, match=sentence):
        refuse_without_motion(swing(inner, outer), paper)


def test_a_run_with_its_held_rows_names_the_option_that_kept_them(swing, paper: Rig) -> None:
    held = replace(swing(0 * T + 1.0, 0 * T + 1.0), keep_rest=True)
    with pytest.raises(RunError, match="import the table without --keep-rest"):
        refuse_without_motion(held, paper)


def test_a_clamped_elbow_and_a_rod_alone_need_not_turn(swing, paper: Rig) -> None:
    refuse_without_motion(replace(swing(INNER, INNER + 1.0), mounting="clamped"), paper)
    refuse_without_motion(replace(swing(INNER, INNER), mounting="inner"), paper)


@pytest.mark.parametrize("keep", [slice(0, 12), slice(0, 60)], ids=["too few samples", "too short"])
def test_a_short_run_names_samples_and_duration(swing, paper: Rig, keep: slice) -> None:
    with pytest.raises(RunError, match=r"samples over .* at least 16 samples over 0\.35 s"):
        refuse_without_motion(swing(INNER[keep], OUTER[keep], T[keep]), paper)


def test_noise_as_large_as_the_motion_is_named(swing, paper: Rig) -> None:
    noise = np.random.default_rng(2).normal(0.0, 1.0, len(T))
    with pytest.raises(RunError, match="the noise hides the swing"):
        refuse_without_motion(swing(INNER + noise, OUTER + noise[::-1]), paper)
