"""Rods that a hand, a hidden drive or a cart moves in a table."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.understand import understand
from tests.storage.test_rod_alone import table

RATE_HZ = 50.0
T = np.arange(0, 6, 1 / RATE_HZ)
HANGING = ImportOptions(zero="hanging")


def swing(angle: float, friction: float = 0.0, noise: float = 2e-3, instants: np.ndarray = T) -> np.ndarray:
    """(n,) angle of a bob at 0.3 m with viscous and Coulomb friction, released at rest, rad."""

    def rates(_: float, state: np.ndarray) -> list[float]:
        resisting = 0.06 * state[1] + friction * math.tanh(state[1] / 0.05)
        return [state[1], -9.81 / 0.3 * math.sin(state[0]) - resisting]

    angles = solve_ivp(rates, (0, instants[-1]), [angle, 0.0], t_eval=instants, rtol=1e-8, atol=1e-8).y[0]
    return angles + np.random.default_rng(4).normal(0, noise, len(angles))


def doubts(folder: Path, rig: Rig, angles: np.ndarray) -> list[str]:
    file = table(folder, "t,theta1", np.arange(len(angles)) / RATE_HZ, angles)
    questions = understand(file, rig, ImportOptions(zero="hanging", keep_rest=True)).questions
    return [question.sentence for question in questions if "a hand" in question.sentence]


def test_a_hand_that_lifts_the_rod_before_the_release(tmp_path: Path, one: Rig) -> None:
    lifted = np.linspace(1.7, 1.75, 25)
    (doubt,) = doubts(tmp_path, one, np.concatenate([lifted, swing(1.75, friction=1.0)]))
    begins = re.match(r"until ([\d.]+) s, the rod accelerates less than gravity.* exclude this part", doubt)
    assert begins
    assert f"--start-s {begins[1]}" in doubt
    assert 24 / RATE_HZ <= float(begins[1]) <= 0.6


@pytest.mark.parametrize(("lifted", "lasts"), [(1.4, 1.5), (0.4, 1.0), (0.6, 0.3)])
def test_a_rod_that_is_lifted_from_hanging_has_one_option(
    lifted: float, lasts: float, tmp_path: Path, one: Rig
) -> None:
    hand = lifted * np.sin(np.pi / 2 * np.arange(0, lasts, 1 / RATE_HZ) / lasts) ** 2
    (doubt,) = doubts(tmp_path, one, np.concatenate([hand, swing(lifted)]))
    begins = re.match(r"use only the swing from [\d.]+ s on \(--start-s ([\d.]+)\)", doubt)
    assert begins
    assert lasts - 0.1 < float(begins[1]) < lasts + 0.4
    assert "--unit" not in doubt


@pytest.mark.parametrize(("angle", "friction"), [(0.7, 0.0), (1.6, 3.0), (2.5, 1.0)])
def test_a_free_release_is_not_attributed_to_a_hand(tmp_path: Path, one: Rig, angle: float, friction: float) -> None:
    assert doubts(tmp_path, one, swing(angle, friction, noise=0.01)) == []


def test_a_rod_that_a_cart_sets_in_motion_is_not_refused_as_pushed(one: Rig, tmp_path: Path) -> None:
    t = np.arange(0, 12, 0.02)
    after = np.maximum(t - 2, 0.0)
    angle = 0.38 * np.sin(2 * after) - 0.1 * np.sin(7 * after) + np.random.default_rng(2).normal(0, 5e-4, len(t))
    read = understand(table(tmp_path, "t,cart,theta", t, 0.4 * np.sin(2 * after), angle), one, HANGING)
    assert any("column cart is not used. If it is the position of a cart" in note for note in read.notes)
    assert read.questions


@pytest.mark.parametrize(
    ("column", "position"),
    [
        ("", None),
        ("x_m", lambda angle, noise: 0.3 * np.sin(angle) + 5e-4 * noise),  # tip of the rod
        ("position", lambda angle, _: np.round(angle * 4096 / (2 * np.pi))),  # counts of the same encoder
        ("cart", lambda _, noise: 1e-5 * noise),
        ("cart", lambda _, noise: np.round(0.4 * noise)),  # counts of a cart at rest
    ],
)
def test_a_column_that_does_not_set_the_rod_in_motion_does_not_hide_a_push(
    column: str, position: Callable[[np.ndarray, np.ndarray], np.ndarray] | None, one: Rig, tmp_path: Path
) -> None:
    t, rng = np.arange(0, 10, 0.02), np.random.default_rng(2)
    angle = 0.6 * np.sin(5.7 * np.maximum(t - 2, 0.0))
    columns = [] if position is None else [position(angle, rng.normal(size=len(t)))]
    header = ",".join(filter(None, ["t", column, "theta"]))
    file = table(tmp_path, header, t, *columns, angle + rng.normal(0, 5e-4, len(t)))
    with pytest.raises(RunError, match=r"hang at rest until 2.* they were pushed") as refusal:
        understand(file, one, HANGING)
    assert (f"Or a cart set the rod in motion: column {column} is not used" in str(refusal.value)) == bool(column)


@pytest.mark.parametrize("column", ["x_m", "other"])
def test_a_rod_on_a_slow_cart_is_not_held(column: str, one: Rig, tmp_path: Path) -> None:
    t = np.arange(0, 20, 0.04)
    x, counts = 0.05 * np.sin(0.8 * t), 4096 / (2 * np.pi)
    angle = 0.0033 * (np.sin(0.8 * t) - 0.8 / 7 * np.exp(-t / 40) * np.sin(7 * t))
    file = table(tmp_path, f"t,{column},theta", t, x, np.round(angle * counts) / counts)
    read = understand(file, one, ImportOptions(zero="hanging"))
    excluded = [note for note in read.notes if "of rest before" in note]
    assert bool(excluded) == (column == "other")
    assert all("excluded, because the rods were not completely still" in note for note in excluded)


def test_a_rod_that_never_accelerates_as_gravity_requires_has_no_free_part(tmp_path: Path, one: Rig) -> None:
    turned = 1.0 + 0.35 * np.sin(np.arange(0, 6, 1 / RATE_HZ))
    assert not [doubt for doubt in doubts(tmp_path, one, turned) if "accelerates less" in doubt]


@pytest.mark.parametrize("hand", [np.linspace(0.15, 1.0, 30), np.array([]), np.full(10, 1.0)])
def test_a_second_swing_is_noticed_although_the_rod_is_not_held(hand: np.ndarray, tmp_path: Path, one: Rig) -> None:
    first = swing(1.2)[: round(4.5 * RATE_HZ)]
    angles = np.concatenate([first, hand, swing(1.0)])
    (doubt,) = doubts(tmp_path, one, angles)
    parts = re.search(r"another swing begins.*separate runs \(--duration-s ([\d.]+); --start-s ([\d.]+)\)", doubt)
    assert parts
    assert 4.0 < float(parts[1]) < 4.6
    assert -0.1 < float(parts[2]) - 4.5 - len(hand) / RATE_HZ < 0.4


def test_a_rise_near_the_first_row_leaves_one_part(tmp_path: Path, one: Rig) -> None:
    """The first and the last swing are too short to use."""
    angles = np.concatenate([swing(0.5)[:10], swing(1.2)[:225], swing(1.2)[:40]])
    (doubt,) = doubts(tmp_path, one, angles)
    assert re.search(r"after 0 s and after 4\.[3-6]\d* s: another swing begins", doubt)
    assert re.search(r"Use only the part without a rise \(--start-s 0\.\d+ --duration-s [34]\.\d+\)$", doubt)


def test_a_push_during_a_swing_is_noticed(tmp_path: Path, one: Rig) -> None:
    first, second = swing(0.8), swing(1.2)
    (doubt,) = doubts(tmp_path, one, np.concatenate([first[:201], second[np.argmax(second < first[200]) :]]))
    assert "another swing begins, a hand or a drive acts" in doubt


def test_strong_air_drag_is_not_attributed_to_a_hand_or_a_drive(tmp_path: Path, one: Rig) -> None:
    """A sail brakes large swings most: neither viscous nor dry friction explains the energy."""

    def rates(_: float, state: np.ndarray) -> list[float]:
        return [state[1], -9.81 / 0.3 * math.sin(state[0]) - 0.7 * abs(state[1]) * state[1]]

    angles = solve_ivp(rates, (0, T[-1]), [1.2, 0.0], t_eval=T, rtol=1e-8, atol=1e-8).y[0]
    file = table(tmp_path, "t,theta1", T, angles + np.random.default_rng(4).normal(0, 1e-3, len(T)))
    assert understand(file, one, HANGING).questions == ()


def test_the_part_without_a_drive_is_named_despite_strong_air_drag(tmp_path: Path, one: Rig) -> None:
    """With viscous friction alone, the part after the drive has a residual between both limits of the question."""

    def rates(t: float, state: np.ndarray) -> list[float]:
        drive = 2.0 * state[1] if t < 3.0 else 0.0
        return [state[1], -9.81 / 0.3 * math.sin(state[0]) - 0.7 * abs(state[1]) * state[1] + drive]

    t = np.arange(0, 10, 1 / RATE_HZ)
    angles = solve_ivp(rates, (0, t[-1]), [1.0, 0.0], t_eval=t, rtol=1e-6, max_step=0.02).y[0]
    file = table(tmp_path, "t,theta1", t, angles + np.random.default_rng(4).normal(0, 1e-3, len(t)))
    (question,) = understand(file, one, HANGING).questions
    begins = re.match(r"use only the swing from ([\d.]+) s on", question.sentence)
    assert begins
    assert 3.0 < float(begins[1]) < 3.5


@pytest.mark.parametrize("noise", [2e-3, 0.02])
def test_noise_is_no_second_swing(noise: float, tmp_path: Path, one: Rig) -> None:
    assert doubts(tmp_path, one, swing(0.4, noise=noise)) == []


def test_a_hand_that_lifts_and_holds_the_rod_makes_no_swing(tmp_path: Path, one: Rig) -> None:
    lifted = 0.8 * np.sin(np.pi / 2 * np.arange(0, 1, 1 / RATE_HZ)) ** 2
    before = np.random.default_rng(3).normal(np.concatenate([np.zeros(50), lifted, np.full(40, 0.8)]), 5e-4)
    angles = np.concatenate([before, swing(0.8, noise=5e-4)])
    read = understand(
        table(tmp_path, "t,theta1", np.arange(len(angles)) / RATE_HZ, angles), one, ImportOptions(zero="hanging")
    )
    assert read.t_offset_s == pytest.approx(len(before) / RATE_HZ, abs=0.06)
    assert read.questions == ()


@pytest.mark.parametrize(
    ("driven", "ends"),
    [
        ((0, 3), r"use only the swing from 3\.[0-6]\d* s on \(--start-s 3"),
        ((7, 10), r"use only the first 6\.[6-9]\d* s \(--duration-s 6"),
        ((0, 10), ""),
        ((0.6, 1.2), ""),  # the free part is shorter than a period
    ],
)
def test_the_part_of_a_swing_without_a_hidden_drive_is_named(tmp_path, one, driven, ends):
    """A coil increases the amplitude of a rod without a torque column, before or after a free decay."""
    lasts = driven[1] if driven[1] < 2 else 10

    def change(t: float, state: np.ndarray) -> list[float]:
        damping = -8 / lasts if driven[0] <= t < driven[1] else 0.2
        return [state[1], -45.3 * np.sin(state[0]) - damping * state[1]]

    t = np.arange(0, lasts, 0.01)
    angle = solve_ivp(change, (0, lasts), [0.2, 0], t_eval=t, max_step=0.01).y[0]
    rows = "".join(f"{t:.2f},{angle:.6f}\n" for t, angle in zip(t, angle, strict=True))
    (tmp_path / "a.csv").write_text("t,angle\n" + rows)
    remarks = " ".join(import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging")).notes)
    assert re.search("the energy of the (swing changes|rods rises) by", remarks)
    assert bool(ends) == ("use only" in remarks) == ("check --unit" not in remarks)
    assert re.search(ends, remarks)


def test_a_part_without_a_hidden_drive_does_not_begin_in_a_gap(tmp_path, one):
    """A coil acts for 3 s; after the usual margin, no rows are recorded."""
    t = np.arange(0, 14, 0.01)
    free = solve_ivp(lambda _, y: [y[1], -45.3 * np.sin(y[0]) - 0.1 * y[1]], (0, 14), [0.6, 0], t_eval=t).y[0]
    rows = np.column_stack([t, np.where(t < 3, 0.4, 1.0) * free])[(t < 3) | (t > 5.5)]
    np.savetxt(tmp_path / "a.csv", rows, "%.6f", ",", header="t,theta", comments="")
    remarks = " ".join(import_csv(tmp_path / "a.csv", one, ImportOptions(zero="hanging")).notes)
    assert 5.51 <= float(re.search(r"--start-s ([\d.]+)", remarks)[1]) < 6
