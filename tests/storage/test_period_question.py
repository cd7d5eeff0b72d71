"""A column whose motion shows that it is not the angle of the rod, or that its unit is another one."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.understand import understand
from tests.storage.test_rod_alone import friction_swing, table

T = np.arange(0, 16, 0.04)


def swing(angle: float, drag: float = 0.0, damping: float = 0.06) -> np.ndarray:
    """(n,) angle of a bob at 0.3 m with viscous friction and air drag, released at rest, rad."""

    def rates(_: float, state: np.ndarray) -> list[float]:
        return [state[1], -9.81 / 0.3 * math.sin(state[0]) - (damping + drag * abs(state[1])) * state[1]]

    return solve_ivp(rates, (0, T[-1]), [angle, 0.0], t_eval=T, rtol=1e-9, atol=1e-9).y[0]


@pytest.mark.parametrize("angle", [0.5, 1.0, 2.0])
def test_a_constant_amplitude_shows_nothing(tmp_path: Path, one: Rig, angle: float) -> None:
    file = table(tmp_path, "t,theta1", T, swing(angle, damping=0.0))
    sentences = [question.sentence for question in understand(file, one, ImportOptions(zero="hanging")).questions]
    assert not [sentence for sentence in sentences if "position of a point" in sentence]


def doubts(folder: Path, rig: Rig, degrees: np.ndarray) -> list[str]:
    noisy = degrees + np.random.default_rng(4).normal(0, 0.3, len(T))
    file = table(folder, "t,theta_deg", T, noisy)
    understood = understand(file, rig, ImportOptions(unit="deg", zero="hanging"))
    return [question.sentence for question in understood.questions if "position of a point" in question.sentence]


def test_a_position_in_mm_is_not_taken_for_an_angle_in_degrees(tmp_path: Path, one: Rig) -> None:
    sentences = doubts(tmp_path, one, 600 * np.sin(swing(0.09)))
    assert len(sentences) == 1
    assert "is the column an angle in deg" in sentences[0]


@pytest.mark.parametrize(("angle", "drag"), [(0.9, 0.0), (2.0, 0.02), (0.09, 0.0)])
def test_a_true_angle_is_not_doubted(tmp_path: Path, one: Rig, angle: float, drag: float) -> None:
    assert not doubts(tmp_path, one, np.degrees(swing(angle, drag)))


def warned(file: Path, rig: Rig, unit: Literal["deg", "counts"] = "deg") -> list[tuple[str, tuple[str, ...]]]:
    options = ImportOptions(unit=unit, zero="hanging")
    return [(doubt.sentence, doubt.mend) for doubt in understand(file, rig, options).questions]


@pytest.mark.parametrize(
    ("header", "mend"), [("t,theta1", ("--unit", "rad")), ("t,theta1_deg", ("--scale", "57.2958"))]
)
def test_radians_that_are_read_as_degrees_are_noticed(
    header: str, mend: tuple[str, ...], tmp_path: Path, one: Rig
) -> None:
    noisy = swing(0.6) + np.random.default_rng(4).normal(0, 1e-3, len(T))
    ((sentence, words),) = warned(table(tmp_path, header, T, noisy), one)
    assert words == mend
    assert "the angles are probably in rad" in sentence
    assert not understand(table(tmp_path, header, T, noisy), one, corrected(mend)).questions


def test_radians_whose_periods_contradict_degrees_are_not_imported(tmp_path: Path, one: Rig) -> None:
    noisy = swing(0.6) + np.random.default_rng(4).normal(0, 1e-3, len(T))
    with pytest.raises(RunError, match="the angles are probably in rad"):
        import_csv(table(tmp_path, "t,theta1_deg", T, noisy), one, ImportOptions(zero="hanging"))


def corrected(mend: tuple[str, ...]) -> ImportOptions:
    if mend[0] == "--unit":
        return ImportOptions(unit="rad", zero="hanging")
    return ImportOptions(scale=dict.fromkeys(("theta1", "theta2"), float(mend[1])), zero="hanging")


def test_a_swing_of_a_fraction_of_a_degree_is_doubted_without_a_sure_option(tmp_path: Path, one: Rig) -> None:
    noisy = swing(0.1) + np.random.default_rng(4).normal(0, 1e-3, len(T))
    ((sentence, words), *_) = warned(table(tmp_path, "t,theta1", T, noisy), one)
    assert "amplitude of the swing is only 0.1 degrees: if the table is in rad, import it with --unit rad" in sentence
    assert not words


@pytest.mark.parametrize("degrees", [1.0, 2.0, 4.0])
def test_a_small_swing_in_degrees_is_not_doubted(degrees: float, tmp_path: Path, one: Rig) -> None:
    small = np.degrees(swing(np.radians(degrees))) + np.random.default_rng(4).normal(0, 0.01, len(T))
    assert not warned(table(tmp_path, "t,theta1_deg", T, small), one)


def test_the_periods_of_a_small_swing_with_coarse_counts_show_that_it_is_in_degrees(tmp_path: Path, one: Rig) -> None:
    """The accelerations agree better with radians, because the amplitude is only a few counts."""
    t = np.arange(0, 30, 0.01)

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -47.33 * math.sin(y[0]) - 0.019 * y[1] - 6.17e-3 * math.tanh(y[1] / 0.01)]

    angle = 0.0427 + solve_ivp(slope, (0, 30), [0.03306, 0.0], t_eval=t, method="LSODA", rtol=1e-7, atol=1e-8).y[0]
    degrees = 360 / 1024 * np.round(angle / (2 * np.pi) * 1024)
    assert not warned(table(tmp_path, "t,theta1_deg", t, degrees), one)


def test_half_the_counts_of_a_turn_change_the_period(tmp_path: Path, one: Rig) -> None:
    counts = np.round(swing(1.2) * one.encoders.counts_per_rev[1] / (4 * np.pi))
    (sentence,) = (sentence for sentence, _ in warned(table(tmp_path, "t,counts", T, counts), one, "counts"))
    assert "times these angles: is counts_per_rev of the rig file correct?" in sentence


def test_small_swings_of_two_rods_in_radians_are_doubted(tmp_path: Path) -> None:
    tables = Path(__file__).parents[2] / "configs" / "tables"
    rows = np.loadtxt(tables / "low.csv", delimiter=",", skiprows=1)
    file = table(tmp_path, "time_s,angle1_deg,angle2_deg", rows[:, 0], *np.radians(rows[:, 1:]).T)
    options = ImportOptions(zero="hanging", angles="relative")
    (doubt,) = understand(file, load_rig(tables / "bench.toml"), options).questions
    assert (
        "amplitude of the swing is only 0.55 degrees: if the table is in rad, import it with --scale" in doubt.sentence
    )


HELD = 24.3 + 1.2 * np.sin(0.9 * T) + 0.3 * np.sin(2.1 * T)
"""A rod that a controller holds at an angle, degrees."""


def asked_for_degrees(folder: Path, rig: Rig, readings: np.ndarray, options: ImportOptions, name: str) -> list[str]:
    read = understand(table(folder, f"t,{name}", T, readings), rig, replace(options, keep_rest=True))
    return [question.sentence for question in read.questions if question.sentence.startswith("as an angle in rad")]


@pytest.mark.parametrize("readings", [HELD, 24 + 4 * np.sin(0.9 * T), 24 + 8 * np.sin(7 * T) * np.exp(-T / 8)])
def test_degrees_without_a_stated_unit_are_noticed_although_a_drive_moves_the_rod(
    tmp_path: Path, one: Rig, readings: np.ndarray
) -> None:
    (sentence,) = asked_for_degrees(tmp_path, one, readings, ImportOptions(), "theta1")
    turns = readings.min() / (2 * np.pi)
    assert f"theta1 stays at least {turns:.3g} turns from the zero" in sentence
    assert "is it in degrees (--unit deg)?" in sentence


@pytest.mark.parametrize(
    ("readings", "options", "name"),
    [
        (HELD, ImportOptions(), "theta1_rad"),
        (HELD, ImportOptions(unit="rad"), "theta1"),
        (HELD, ImportOptions(scale={"theta1": -1.0}), "theta1"),
        (np.round(np.radians(HELD) / 0.02) * 0.02, ImportOptions(), "theta1"),
        (np.linspace(0.0, 80.0, len(T)), ImportOptions(), "theta1"),  # a rod that turns fast
        (np.round(swing(1.0), 1), ImportOptions(zero="hanging"), "theta1"),
        (swing(0.8) + 4 * np.pi, ImportOptions(zero="hanging"), "theta1"),  # an encoder of several turns
        (np.round(swing(0.8) + 5 * np.pi, 1), ImportOptions(), "theta1"),
    ],
)
def test_radians_are_not_taken_for_degrees(
    tmp_path: Path, one: Rig, readings: np.ndarray, options: ImportOptions, name: str
) -> None:
    assert not asked_for_degrees(tmp_path, one, readings, options, name)


@pytest.mark.parametrize("stated", [None, "rad"])
def test_a_table_in_degrees_is_not_imported_as_radians(one: Rig, tmp_path: Path, stated: str | None) -> None:
    file = table(tmp_path, "t,theta1", friction_swing(one) * [1.0, 180 / np.pi])
    options = ImportOptions(zero="hanging", unit=stated)  # pyright: ignore[reportArgumentType]
    for out in (None, tmp_path / "a.mcap"):
        with pytest.raises(RunError, match=r"\(--unit deg\)\. If the angles are in rad nevertheless, add --scale 1"):
            import_csv(file, one, options, out)
    assert not (tmp_path / "a.mcap").exists()
    forced = import_csv(file, one, replace(options, scale={"theta1": 1.0}))
    assert any("--unit deg" in note for note in forced.notes)
    assert import_csv(file, one, replace(options, unit="deg")).notes == ()
