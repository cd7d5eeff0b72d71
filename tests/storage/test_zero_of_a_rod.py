"""Zero and height of a single rod in a table."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.tables.understand import understand
from tests.storage.test_hand_question import swing

T = np.arange(0, 1, 0.01)


def table(folder: Path, header: str, *columns: np.ndarray) -> Path:
    file = folder / "swing.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="")
    return file


@pytest.mark.parametrize("preset", [0, 1 << 15])
def test_a_signed_counter_stored_without_sign_keeps_its_zero(one: Rig, tmp_path: Path, preset: int) -> None:
    encoders = one.encoders.model_copy(update={"zero_counts": (0, preset, preset)})
    rig = one.model_copy(update={"encoders": encoders})
    counts = np.round(700 * np.cos(7 * T) - 1)
    file = table(tmp_path, "t,theta1", T, (preset + counts) % 2**16)
    options = ImportOptions(zero="hanging", unit="counts", wrap=2.0**16, columns={"theta1": "theta1"}, keep_rest=True)
    turn = 2 * np.pi / rig.encoders.counts_per_rev[1]
    np.testing.assert_allclose(import_csv(file, rig, options).theta[:, 1] - np.pi, counts * turn, atol=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_zero_of_a_scaled_counter_is_its_offset(one: Rig, tmp_path: Path, sign: int) -> None:
    counts = np.round(700 * np.cos(7 * T)) * sign
    file = table(tmp_path, "t,theta1", T, (40_000 + counts) % 2**16)
    scaled = {"scale": {"theta1": 1e-3}, "offset": {"theta1": -40.0}}
    run = import_csv(file, one, ImportOptions(zero="hanging", unit="rad", wrap=2.0**16, keep_rest=True, **scaled))
    np.testing.assert_allclose(run.theta[:, 1] - np.pi, counts * 1e-3, atol=1e-9)


@pytest.mark.parametrize(("zero", "asks"), [("upright", False), ("hanging", True)])
def test_a_rod_that_lingers_upright_before_it_falls_needs_no_other_zero(
    one: Rig, tmp_path: Path, zero: str, asks: bool
) -> None:
    t = np.arange(0.0, 2.2, 0.01)
    fall = 4 * np.arctan(np.exp(5.5 * (t - 1.6)))  # separatrix of a rod with 5.5 rad/s
    angle = fall if zero == "upright" else 2.5 * np.sin(5 * t) ** 3
    notes = import_csv(table(tmp_path, "t,theta1", t, angle), one, ImportOptions(keep_rest=True)).notes
    assert any("points upwards most of the time" in note for note in notes) is asks


@pytest.mark.parametrize(
    ("unit", "offset", "uncertain"), [("rad", "-0.3", "0.005 rad"), ("deg", "-17.2", "0.3 degrees")]
)
@pytest.mark.parametrize("rezeroed", [False, True])
def test_a_proposed_zero_has_an_uncertainty_that_the_fit_may_correct(
    rezeroed: bool, unit: Literal["rad", "deg"], offset: str, uncertain: str, one: Rig, tmp_path: Path
) -> None:
    rig = one.model_copy(update={"encoders": one.encoders.model_copy(update={"rezeroed": rezeroed})})
    t = np.arange(0.0, 8.0, 0.01)
    angle = 0.3 + swing(1.2, 0.3, 1e-3, t)
    file = table(tmp_path, "t,theta1", t, angle if unit == "rad" else np.degrees(angle))
    (doubt,) = understand(file, rig, ImportOptions(zero="hanging", unit=unit)).questions
    assert doubt.mend == ("--offset", offset)
    fit = "the fit corrects them"
    ending = fit if rezeroed else f"with rezeroed = true in [encoders] of the rig file, {fit}"
    assert doubt.sentence.endswith(f"Proposed zeros are uncertain by about {uncertain}: {ending}")


def test_a_camera_turned_by_eight_degrees_is_named_if_the_swing_is_as_small(one: Rig, tmp_path: Path) -> None:
    """The zero error exceeds the errors that the energy test admits, but not the limit for a proposed correction."""
    t = np.arange(0, 8, 1 / 30)
    angle = 0.14 + 0.15 * np.exp(-0.02 * t) * np.cos(6.7 * t)
    x, y = 900 * np.sin(angle), 900 * np.cos(angle)
    noisy = np.stack([x, y], 1) + np.random.default_rng(5).normal(0, 2, (len(t), 2))
    file = table(tmp_path, "t,x,y", t, np.round(noisy))
    (asked,) = understand(file, one, ImportOptions()).questions
    assert "if the camera is turned" in asked.sentence
    offset = float(asked.sentence.rpartition("--offset ")[2].rstrip(")"))
    assert abs(offset) == pytest.approx(0.14, abs=0.02)
    assert not understand(file, one, ImportOptions(offset={"theta1": offset})).questions
