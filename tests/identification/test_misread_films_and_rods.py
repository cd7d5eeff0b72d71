"""Wrong interpretations of films and of single rods are named; correct ones are accepted."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dpr_lab.errors import IdentificationError
from dpr_lab.identification.misread import energy, tried
from dpr_lab.identification.misread.energy import ENERGY, energy_rise
from dpr_lab.identification.misread.local_motion import shows_a_period
from dpr_lab.identification.misread.readings import readings
from dpr_lab.identification.misread.refuse import refuse_misread
from dpr_lab.identification.misread.tried import check_description
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import FilmNoise, Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from tests.bench_rigs import rods_swing, table
from tests.one_rod import Rod, swing

PI = np.pi


@pytest.mark.slow
def test_a_film_of_rods_in_good_bearings_lets_no_energy_in(
    paper: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """100 frames a second of short rods, the pivot marked wrongly: the errors exceed the energy lost to friction."""
    p = {"a": 13.1, "b": 1.0, "d": 1.38, "e1": 1390.0, "e2": 1.38 * 9.81 / 0.0917, "c2": 0.2}
    p |= dict.fromkeys(("rotor", "c1", "f1", "f2", "drag", "drag2"), 0.0)
    rig = paper.model_copy(update={"rig": paper.rig.model_copy(update={"L1": 0.0917})})
    q = rods_swing(p, [3.1, 3.0], np.arange(0.0, 2.0, 0.01))
    film = q + 0.03 * np.sin(q + 1.0) + np.random.default_rng(0).normal(0.0, 3e-3, q.shape)
    t = np.arange(len(q)) / 100
    run = table(tmp_path, "film", rig, {"t_s": t, "theta1_rad": film[:, 0], "theta2_rad": film[:, 1]})
    prepared = [preprocess(run, rig)]
    assert energy_rise(prepared, rig) < ENERGY.entering
    monkeypatch.setattr(energy, "ENERGY", replace(ENERGY, least_exchange=0.0))
    assert energy_rise(prepared, rig) > ENERGY.entering


@pytest.mark.slow
def test_a_noisy_film_in_slow_motion_is_named(paper: Rig, tmp_path: Path, few_readings) -> None:
    """Its segments contain so little of the swing that unlikely masses fit them nearly as well."""
    few_readings("time stamps")
    noise, t = 5e-3, np.arange(0.0, 1.1, 1 / 240)
    rods = {"a": 2.4, "b": 1.0, "d": 1.0, "e1": 170.0, "e2": 70.0, "c1": 0.0, "c2": 0.0, "f1": 0.0, "f2": 0.0}
    rods |= {"drag": 0.0, "drag2": 0.0, "rotor": 0.0}
    swung = rods_swing(rods, [1.2, 1.3], t) + np.random.default_rng(2).normal(0, noise, (len(t), 2))
    rig = paper.model_copy(update={"rig": paper.rig.model_copy(update={"L1": 9.81 * rods["d"] / rods["e2"]})})
    columns = {"t_s": 4 * t, "theta1_rad": swung[:, 0], "theta2_rad": swung[:, 1]}
    film = replace(table(tmp_path, "film", rig, columns), film_noise=FilmNoise((noise, noise), 0.0))
    assert "the swing is four times as fast" in check_description([film], rig).sentence


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dry", "damping"),
    [
        (0.035, 0.02),
        pytest.param(0.05, 0.05, marks=pytest.mark.long),
        pytest.param(0.035, 0.11, marks=pytest.mark.long),
    ],
)
def test_a_rod_that_soon_sticks_is_not_read_in_degrees(tmp_path: Path, dry: float, damping: float) -> None:
    rod = Rod(length=0.072, mass=0.02, dry=dry, damping=damping, counts=4096, duration=1.94)
    measures = RigMeasures("one rod", 0.07, 0.07, Measure(0.02), Measure(0.02), counts_per_rev=4096)
    rig = parse_rig(draft_rig(measures)).with_rods("inner")
    t = np.arange(0, rod.duration, 0.005)
    angle = swing(rod, -0.55, t) - 0.0085
    count = 2 * np.pi / rod.counts
    read = count * np.rint((angle + 0.004 * np.sin(6 * angle)) / count)
    path = tmp_path / "swing.csv"
    np.savetxt(path, np.column_stack([t, read]), delimiter=",", header="t_s,theta1_rad", comments="", fmt="%.9f")
    refuse_misread([import_csv(path, rig, ImportOptions(zero="hanging"))], rig)


def test_a_rod_alone_has_no_interpretation_of_joint_2(paper: Rig):
    t = np.arange(0.0, 2.0, 0.01)
    theta = np.column_stack([0.0 * t, np.pi + 0.5 * np.cos(8 * t), np.full_like(t, np.pi)])
    both = Run("swing", t, theta, None, "", paper.name, "", 100.0)
    alone = replace(both, mounting="inner")
    of_both, of_alone = ({r.cause for r in readings(paper) if r.read(run) is not None} for run in (both, alone))
    assert any("joint 2" in cause for cause in of_both)
    assert any(cause.startswith("one rod's sign") for cause in of_both)
    assert any("joint 1 turns by 2 times the reading" in cause for cause in of_alone)
    assert not any(
        words in cause for cause in of_alone for words in ("joint 2 turns", "of joint 2", "outer rod", "one rod's sign")
    )


def test_a_fall_in_one_direction_shows_no_pace(paper: Rig) -> None:
    t = np.arange(0.0, 2.0, 0.01)
    swung = np.column_stack([np.pi + 0.5 * np.cos(4 * t), np.full_like(t, np.pi)])
    fallen = np.column_stack([0.1 * np.cosh(2 * t) + 1e-3 * np.sin(90 * t), np.full_like(t, np.pi)])
    assert shows_a_period(swung)
    assert shows_a_period(np.column_stack([4.0 * t, swung[:, 1]]))
    assert not shows_a_period(fallen)
    run = Run("fall", t, np.column_stack([0 * t, fallen]), None, "", paper.name, "", 100.0)
    causes = {reading.cause for reading in readings(paper) if reading.read(run) is not None}
    assert not any("as fast as its time stamps" in cause for cause in causes)
    assert any("milliseconds" in cause for cause in causes)


@pytest.mark.slow
def test_a_rod_whose_zero_is_opposite_is_not_called_slow(tmp_path: Path, few_readings) -> None:
    few_readings("zero of the angles|time stamps")
    measures = RigMeasures("one rod", 0.3, 0.3, Measure(0.1), Measure(0.1), counts_per_rev=2400)
    rig = parse_rig(draft_rig(measures)).with_rods("inner")
    t = np.arange(0, 6, 0.01)
    angle = np.pi + swing(Rod(length=0.3, mass=0.1, dry=0.0, damping=0.002, counts=2400, duration=6.0), 1.2, t)
    theta = np.column_stack([0 * t, angle - np.pi, np.full_like(t, np.pi)])
    run = replace(Run("swing", t, theta, None, "", rig.name, "", 100.0), mounting="inner")
    with pytest.raises(IdentificationError, match=r"another interpretation fits: the zero of the angles is in the opp"):
        refuse_misread([run], rig)


@pytest.mark.parametrize(("chi2_per_dof", "accepted"), [(0.5, True), (1.5, False)])
def test_a_reading_that_leaves_only_noise_is_accepted_although_the_noise_is_large(
    monkeypatch: pytest.MonkeyPatch, paper: Rig, chi2_per_dof: float, accepted: bool
) -> None:
    """Positions of a cart in steps of 10 mm cause errors of the angle of more than 2 % of the swing."""
    reading, ratio_fit = readings(paper)[0], SimpleNamespace(chi2_per_dof=chi2_per_dof)
    monkeypatch.setattr(tried, "_otherwise", lambda *_: [(reading, ratio_fit)])
    monkeypatch.setattr(tried, "_larger_noise", lambda *_: 1.0)
    monkeypatch.setattr(tried, "residual", lambda _: 0.023)
    explaining = [*tried._explaining([reading], [], paper, 12.5, 3.3)]
    assert bool(explaining) == accepted
