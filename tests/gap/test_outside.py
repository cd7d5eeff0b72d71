"""Rigs of `benchmarks/outside.py`: their motion agrees with independent solutions, and none is described wrongly."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from dpr_lab.effects import EFFECTS

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from _situations import BACKGROUND, SITUATIONS, Plant, double_swing, peg_swing, swing
from outside import Case, tables

PLANT = Plant(length=0.5, w2=9.81 / 0.5, viscous=0.0, coulomb=0.0, start=1.2, t=np.arange(0, 3, 0.01))


def test_a_rod_without_friction_follows_the_elliptic_function_of_its_swing() -> None:
    m = np.sin(PLANT.start / 2) ** 2
    sn = ellipj(ellipk(m) - np.sqrt(PLANT.w2) * PLANT.t, m)[0]
    np.testing.assert_allclose(swing(PLANT), 2 * np.arcsin(np.sqrt(m) * sn), atol=1e-6)


def test_two_rods_without_friction_keep_their_energy() -> None:
    q1, q2 = double_swing(PLANT).T
    u1, u2 = (np.gradient(q, PLANT.t, edge_order=2) for q in (q1, q2))
    kinetic = 2 * u1**2 + u2**2 / 2 + 1.5 * np.cos(q1 - q2) * u1 * u2
    energy = kinetic - 1.5 * 9.81 / PLANT.length * (3 * np.cos(q1) + np.cos(q2))
    np.testing.assert_allclose(energy[2:-2], energy[2], atol=0.01 * np.ptp(kinetic))


def test_a_peg_below_the_pivot_shortens_a_half_of_each_small_swing() -> None:
    small = replace(PLANT, start=0.01)
    q = peg_swing(small, 0.35, 0.0)
    rising = small.t[1:][(q[:-1] < 0) & (q[1:] >= 0)]
    period = np.pi / np.sqrt(9.81 / 0.5) + np.pi / np.sqrt(9.81 / 0.35)
    assert np.diff(rising).mean() == pytest.approx(period, abs=0.01)


def test_correct_effects_exist_in_the_library() -> None:
    correct = {start for situation in SITUATIONS.values() for start in (*BACKGROUND, *situation.correct)}
    assert [start for start in correct if not any(name.startswith(start) for name in EFFECTS)] == []


def test_an_effect_of_neither_the_background_nor_the_situation_is_wrong(tmp_path: Path) -> None:
    name, rig, files = tables(1180001, tmp_path)
    assert (name, rig.joints.inner, len(files)) == ("peg", "free", 1)
    named = ((("spring_joint1",), 0.95), (("com_offset_link1", "base_tilt"), 0.97))
    assert [Case(0, name, "named", named).wrong(above) for above in (0.5, 0.96)] == [1, 0]
